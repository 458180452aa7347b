"""The one loop from scans to fixes: of a site that is asked scan by scan, or of a tracker."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker

if TYPE_CHECKING:
    from pipeline.online.level_site import LevelSite, LevelTracker


class Localized(NamedTuple):
    """A scan and its fix."""

    scan: Scan
    points_m: NDArray[np.float64]
    """(n, 3) as the scan holds them."""
    fix: Fix


def localized(
    scans: Iterable[Scan],
    localizer: "Site | Tracker | LevelTracker",
    promise: float | None,
    broken: list[str],
) -> Iterator[Localized]:
    """The fix of each scan, one after the other; a tracker has a promise of its own.

    A scan that cannot be read is passed over, and why is appended to `broken`.
    """
    for scan in scans:
        try:
            points_m = scan.points()
        except (LogError, OSError) as error:
            reason = str(error)
            broken.append(reason if scan.name in reason else f"{scan.name}: {reason}")
            continue
        if isinstance(localizer, Site):
            yield Localized(scan, points_m, localizer.localize(points_m, promise))
        else:
            yield Localized(scan, points_m, localizer.follow(scan, points_m))


def tracker_of(site: Site, promise: float | None, track: bool) -> "Tracker | LevelTracker | None":
    """What follows the scans of a site; None where each is localised alone.

    The sweeps of a level site are gathered, tracked or not.
    """
    if site.is_level:
        from pipeline.online.level_site import LevelTracker  # which other sites never need

        return LevelTracker(cast("LevelSite", site), promise, is_tracking=track)
    return Tracker(site, promise) if track else None
