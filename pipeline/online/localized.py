"""The loop from scans to fixes that all commands share: each scan alone, or one after the other."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker


class Localized(NamedTuple):
    """A scan, and what was made of it."""

    scan: Scan
    points_m: NDArray[np.float64]
    """(n, 3) the scan's points, in metres."""
    fix: Fix


def localized(
    scans: Iterable[Scan],
    localizer: Site | Tracker,
    target_precision: float | None,
    broken: list[str],
) -> Iterator[Localized]:
    """The fix of each scan, one after the other.

    A site localises each scan alone, with `target_precision`; a tracker follows them, with its own
    target precision. A scan that cannot be read is passed over, and the reason is appended to
    `broken`.
    """
    for scan in scans:
        try:
            points_m = scan.points()
        except (LogError, OSError) as error:
            reason = str(error)
            broken.append(reason if scan.name in reason else f"{scan.name}: {reason}")
            continue
        if isinstance(localizer, Site):
            yield Localized(scan, points_m, localizer.localize(points_m, target_precision))
        else:
            yield Localized(scan, points_m, localizer.follow(scan, points_m))


def tracker_of(site: Site, target_precision: float | None, track: bool) -> Tracker | None:
    """The tracker that follows the scans in a site; None if each scan is localised alone.

    A level site always has one, since its sweeps are gathered; `track` says if it tracks the robot.
    """
    return Tracker(site, target_precision, is_tracking=track) if track or site.gathers else None
