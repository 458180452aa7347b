"""The public front: asks a packed site where a scan was taken, and whether to accept that.

    from yearloc import Site

    site = Site.open("campus.site")
    fix = site.localize(points_m)
    if fix.verdict == "accepted":
        print(fix.world_T_sensor)

A `Prior` says where a robot is believed to be. A `Tracker` follows a robot scan by scan, also a
robot with a level 2-D laser. `EXAMPLE` is a folder with a small simulated site and three scans,
which `yearloc example` localises. These names keep their meaning from one version to the next; all
else in `pipeline` may change.
"""

from pipeline.core.errors import YearlocError
from pipeline.online.example import FOLDER as EXAMPLE
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker
from pipeline.posing.prior import Prior

__all__ = ["EXAMPLE", "Fix", "Prior", "Site", "Tracker", "YearlocError"]
