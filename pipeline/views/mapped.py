"""Bird-views of submaps, from one octree that every scan of the sequence is inserted into, in order
(METHODS 4.4)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses
from pipeline.core.schemas import BirdViews, Scans, Submaps
from pipeline.mapping.gathering import scan_points
from pipeline.mapping.octree import OctreeMap, Variance
from pipeline.views.birdview import BirdView
from pipeline.views.draw import write_views


@dataclass(frozen=True)
class MappedViews:
    """The bird-views of a submaps artifact; each shows the octree after the scans up to the
    submap's anchor."""

    scans: Scans
    submaps: Submaps
    view: BirdView
    alter: Callable[[int, NDArray[np.float64]], NDArray[np.float64]] | None = None
    """Changes the points (n, 3) of a scan, given its row, before they are inserted; z is up from
    the ground."""

    def __len__(self) -> int:
        return int(self.submaps["scans"].shape[0])

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Images (heading, row, column) of each submap."""
        for number, (_, grown, pose) in enumerate(self.maps()):
            yield self.view.draw(grown, pose, number)

    def write(self, path: Path) -> str:
        """All views as an artifact at `path`; returns how many, of what shape.

        Raises ArtifactError if all are blank.
        """
        complaint = "all bird-views are blank; is the ground at 0, and anything within the z band?"
        return write_views(
            path,
            BirdViews,
            self.submaps,
            ((images[None], images[:1] > 0) for images in self),
            complaint,
        )

    def maps(self) -> Iterator[tuple[NDArray[np.float64], OctreeMap, Poses]]:
        """At each submap's anchor: the points (n, 3) of its scan, the map, and the robot's pose in
        it (4, 4).

        The map is one object, which goes on growing. Poses are the log's odometry, or its ground
        truth where it has no odometry at all. A scan without odometry, as after a break, gets an
        empty map of its own, and so does the scan after it.
        """
        odom_T_scan = self.scans.load("odom_T_scan")
        if not np.isfinite(odom_T_scan).all(axis=(1, 2)).any():
            odom_T_scan = self.scans.load("world_T_scan")
        variances = motion_variances(self.scans.load("odom_variance"))
        anchors = self.submaps.load("scans")
        ground_m = self.submaps.load("ground_m")
        grown = self.view.octree.grow()
        number = 0
        for row, points in scan_points(self.scans, 0, int(anchors[-1]) + 1):
            has_odometry = np.isfinite(odom_T_scan[row]).all()
            scan_T_ground = np.eye(4)
            scan_T_ground[2, 3] = ground_m[number]
            pose = (odom_T_scan[row] if has_odometry else np.eye(4)) @ scan_T_ground
            grown = grown if has_odometry else self.view.octree.grow()
            points = points - scan_T_ground[:3, 3]
            points = self.alter(row, points) if self.alter else points
            grown.insert(points, pose, variances[row])
            if anchors[number] == row:
                yield points, grown, self.view.standing(points, pose)
                number += 1
            grown = grown if has_odometry else self.view.octree.grow()


def motion_variances(gathered: NDArray[np.float64]) -> list[Variance | None]:
    """Of each scan, what the log says of the motion since the scan before it.

    From what the odometry had gathered at each scan (scan, 2). None where it says nothing, or
    gathers nothing: a variance that never grows, as many drivers send, says nothing of a motion.
    """
    grown = np.diff(gathered, axis=0, prepend=np.nan)
    return [
        (position_m2, heading_rad2) if position_m2 > 0 and heading_rad2 > 0 else None
        for position_m2, heading_rad2 in grown.tolist()
    ]
