"""Ask a packed site where a scan was taken, and whether to believe it.

    from yearloc import Site

    site = Site.open("campus.site")
    fix = site.localize(points_m)
    if fix.verdict == "accepted":
        print(fix.world_T_sensor)

A `Tracker` follows a drive scan by scan, a `LevelTracker` that of a level 2-D laser. `EXAMPLE` is a
folder with a small simulated site and scans, which `yearloc example` asks about. These names keep
their meaning from one version to the next; whatever else lies in `pipeline` may change.
"""

from pipeline.core.errors import YearlocError
from pipeline.online.example import FOLDER as EXAMPLE
from pipeline.online.level_site import LevelTracker
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker

__all__ = ["EXAMPLE", "Fix", "LevelTracker", "Site", "Tracker", "YearlocError"]
