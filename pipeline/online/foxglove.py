"""Records a localised drive as an MCAP bag that Foxglove and Lichtblick open.

It shows the map, each scan where its fix placed it, every pose as a point, and the accepted poses
(`yearloc watch --save FILE.mcap`).
"""

from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.online.inputs import Scan
from pipeline.online.outputs import FRAME, stamp_of, whole_bag, write_fix
from pipeline.online.site import Fix, Site
from pipeline.online.watch import origin, whole_map

SITE = "site"
"""A frame in the middle of the site, in which clouds are written, since float32 is too coarse for
coordinates in the world."""
VERDICT_NUMBERS = ("accepted", "rejected", "near", "ambiguous")
"""On /fixes the intensity of a point is the number of its verdict in this order."""


class Recording(ExitStack):
    """Writes FILE.mcap, whole or not at all.

    Its topics are /map, /scan, /fixes (one point for each pose) and /fix (the accepted poses).
    Clouds are in the frame `site`, poses in `map`; /tf_static connects the two frames.
    """

    def __init__(self, site: Site, out: Path | None, target_precision: float | None) -> None:
        """Begin the recording `out`.

        `yearloc watch` makes all kinds of recordings with these arguments. This kind always has a
        file, and does not use the target precision.
        """
        super().__init__()
        assert out is not None
        self._origin_m = origin(site)
        self._map_m = whole_map(site) - self._origin_m
        self._bag = self.enter_context(whole_bag(out))
        self._fixes: list[tuple[float, ...]] = []
        self._has_map = False

    def add(self, number: int, scan: Scan, points_m: NDArray[np.float64], fix: Fix) -> None:
        """Add a scan (n, 3) and its fix, at its stamp or, without a stamp, at `number` seconds."""
        stamp_ns = stamp_of(scan, number)
        if not self._has_map:
            self._add_map(stamp_ns)
        if fix.verdict == "no pose":
            return
        position_m = fix.world_T_sensor[:3, 3] - self._origin_m
        placed_m = points_m @ fix.world_T_sensor[:3, :3].T + position_m
        self._add_cloud(stamp_ns, placed_m, "/scan", placed_m[:, 2])
        # all fixes so far are written each time: a viewer shows the last message of a topic only
        self._fixes.append((*position_m, VERDICT_NUMBERS.index(fix.verdict)))
        fixes = np.array(self._fixes)
        self._add_cloud(stamp_ns, fixes[:, :3], "/fixes", fixes[:, 3])
        write_fix(self._bag, stamp_ns, fix)

    def _add_map(self, stamp_ns: int) -> None:
        """Write the map, and the transform from the frame `map` to `site`."""
        map_T_site = np.eye(4)
        map_T_site[:3, 3] = self._origin_m
        self._bag.static_transform(stamp_ns, FRAME, SITE, map_T_site)
        self._add_cloud(stamp_ns, self._map_m, "/map", np.zeros(len(self._map_m)))
        self._has_map = True

    def _add_cloud(
        self,
        stamp_ns: int,
        points_m: NDArray[np.floating],
        topic: str,
        intensity: NDArray[np.floating],
    ) -> None:
        """Write a cloud of points (n, 3) in the frame `site`, with intensities (n,)."""
        self._bag.points(
            stamp_ns,
            SITE,
            points_m.astype(np.float32),
            intensity,
            np.zeros(len(points_m), int),
            topic,
        )
