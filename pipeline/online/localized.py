"""The loop from scans to fixes that all commands share: each scan alone, or all tracked."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker
from pipeline.posing.prior import Prior


class Localized(NamedTuple):
    """A scan, its points and its fix."""

    scan: Scan
    points_m: NDArray[np.float64]
    """(n, 3) the scan's points, in metres."""
    fix: Fix


def localized(
    scans: Iterable[Scan],
    localizer: Site | Tracker,
    target_precision: float | None,
    broken: list[str],
    prior: Prior | None = None,
) -> Iterator[Localized]:
    """The fix of each scan, one after the other.

    A site localises each scan alone, with `target_precision`; a tracker combines all scans so far,
    with its own target precision. A scan that cannot be read is left out, and the reason is
    appended to `broken`. A prior is of each scan, or of the first alone if the robot is tracked;
    a scan's own prior goes before it, and is used of a tracked robot only while that is lost.
    """
    for scan in scans:
        try:
            points_m = scan.points()
        except (LogError, OSError) as error:
            reason = str(error)
            broken.append(reason if scan.name in reason else f"{scan.name}: {reason}")
            continue
        if isinstance(localizer, Site):
            yield Localized(
                scan, points_m, localizer.localize(points_m, target_precision, scan.prior or prior)
            )
        else:
            own_prior = scan.prior if localizer.is_lost else None
            yield Localized(scan, points_m, localizer.follow(scan, points_m, own_prior or prior))
            prior = None if localizer.is_tracking else prior


def tracker_of(site: Site, target_precision: float | None, track: bool) -> Tracker | None:
    """The tracker for the scans of a drive; None if each scan is localised alone.

    A level site always needs a tracker, which gathers its sweeps; `track` says whether it tracks
    the robot too.
    """
    return Tracker(site, target_precision, is_tracking=track) if track or site.gathers else None
