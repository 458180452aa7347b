"""Records a localised drive as an MCAP bag that Foxglove and Lichtblick open.

It shows the map, each scan where its fix placed it, every pose as a point, and the accepted poses
(`yearloc watch -o FILE.mcap`).
"""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.replacing import replace
from pipeline.formats.bag import BagWriter
from pipeline.online.inputs import Scan
from pipeline.online.outputs import in_world
from pipeline.online.site import Fix, Site
from pipeline.online.watch import origin, whole_map

FRAME = "map"
"""The frame of the world, in which poses are."""
SITE = "site"
"""A frame in the middle of the site. Clouds are given in it, since their float32 is too coarse for
coordinates of the world."""
VERDICT_NUMBERS = ("accepted", "rejected", "near", "ambiguous")
"""On /fixes the intensity of a point is the number of its verdict in this order."""


class Recording:
    """Writes FILE.mcap, whole or not at all.

    Its topics are /map, /scan, /fixes (one point for each pose) and /fix (the accepted poses).
    Clouds are in the frame `site`, poses in `map`; /tf_static leads from one to the other.
    """

    def __init__(self, site: Site, out: Path | None, promise: float | None) -> None:
        """Begin the recording `out`.

        `yearloc watch` makes all its streams with these arguments: this one always has a file, and
        needs no promise.
        """
        assert out is not None
        self._origin_m = origin(site)
        self._out = out
        self._map_m = whole_map(site) - self._origin_m
        self._scratch = TemporaryDirectory()
        self._folder = Path(self._scratch.name, "recording")
        self._bag = BagWriter(self._folder, "mcap").__enter__()
        self._fixes: list[tuple[float, ...]] = []
        self._has_map = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._scratch:
            self._bag.__exit__(kind, error, trace)  # only now is the file whole
            if kind is None:
                (recording_file,) = self._folder.glob("*.mcap")
                with replace(self._out) as whole:
                    shutil.move(recording_file, whole)

    def add(self, number: int, scan: Scan, points_m: NDArray[np.float64], fix: Fix) -> None:
        """Add a scan (n, 3) and its fix, at its stamp or else at its number in seconds."""
        stamp_ns = number * 10**9 if scan.stamp_ns is None else scan.stamp_ns
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
        if fix.verdict == "accepted":
            self._bag.pose_with_covariance(
                stamp_ns, FRAME, fix.world_T_sensor, in_world(fix), "/fix"
            )

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
