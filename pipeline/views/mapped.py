"""Draws the bird-views of submaps: the artifacts of scans and submaps in, an artifact of views out.

All scans of the sequence are inserted into one octree, in their order (METHODS 4.4). The bird-view
of a submap shows the octree as it is after the scan of the submap's anchor.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core.compute import Compute
from pipeline.core.frames import Poses
from pipeline.mapping.gathering import scan_points
from pipeline.mapping.octree import OctreeMap, Variance
from pipeline.views.birdview import BirdView
from pipeline.views.draw import Drawing


@dataclass(frozen=True)
class MappedViews(Drawing):
    """Iterates over the bird-views of a submaps artifact."""

    view: BirdView
    perturb: Callable[[int, NDArray[np.float64]], NDArray[np.float64]] | None = None
    """A function that changes a scan before it is inserted: it takes the scan's row and its points
    (n, 3), z up from the ground, and returns the changed points."""
    complaint: ClassVar[str] = (
        "all bird-views are blank; is the ground at 0, and anything within the z band?"
    )

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the images (heading, row, column) of each submap."""
        for number, (_, octree_map, odom_T_robot) in enumerate(self.maps()):
            yield self.view.draw(octree_map, odom_T_robot, number)

    def blocks(self, compute: Compute) -> Iterator[NDArray[np.uint8]]:
        """Yield the images (1, heading, row, column) of each submap, drawn in their order."""
        return (images[None] for images in self)

    def shows(self, images: NDArray[Any]) -> NDArray[np.bool_]:
        """True where the first heading of bird-views (n, heading, row, column) shows something."""
        return np.asarray(images[:, :1] > 0)

    def maps(self) -> Iterator[tuple[NDArray[np.float64], OctreeMap, Poses]]:
        """Yield, at each submap's anchor, its points (n, 3), the map, and the robot's pose (4, 4).

        The points are those of the anchor's scan, and the pose is by `BirdView.standing`, in the
        map's frame. The map is one object, which goes on growing until odometry breaks. Poses are
        those of the log's odometry, or the true ones if it has none at all. A scan without
        odometry, as after a break, gets a map of its own, and the next scan begins a new one.
        """
        odom_T_scan = self.scans.load("odom_T_scan")
        if not np.isfinite(odom_T_scan).all(axis=(1, 2)).any():
            odom_T_scan = self.scans.load("world_T_scan")
        variances = motion_variances(self.scans.load("odom_variance"))
        anchors = self.submaps.load("scans")
        ground_m = self.submaps.load("ground_m")
        octree_map = self.view.octree.grow()
        number = 0
        for row, points in scan_points(self.scans, 0, int(anchors[-1]) + 1):
            # 1. Put the scan on the ground, and perturb it where the case says so.
            scan_T_ground = np.eye(4)
            scan_T_ground[2, 3] = ground_m[number]
            points = points - scan_T_ground[:3, 3]
            if self.perturb:
                points = self.perturb(row, points)

            # 2. Insert it into the map at its pose.
            has_odometry = np.isfinite(odom_T_scan[row]).all()
            odom_T_ground = scan_T_ground
            if has_odometry:
                odom_T_ground = odom_T_scan[row] @ scan_T_ground
            else:
                octree_map = self.view.octree.grow()
            octree_map.insert(points, odom_T_ground, variances[row])

            # 3. At an anchor, show the map.
            if anchors[number] == row:
                yield points, octree_map, self.view.standing(points, odom_T_ground)
                number += 1
            if not has_odometry:
                octree_map = self.view.octree.grow()


def motion_variances(odom_variance: NDArray[np.float64]) -> list[Variance | None]:
    """The variances of each scan's motion since the scan before, or None if the log gives none.

    `odom_variance` (scan, 2) is what odometry's variances of position and heading have grown to by
    each scan. A motion has what they grew by. Where they do not grow, as many drivers send them,
    they say nothing of the motion.
    """
    variances: list[Variance | None] = []
    for position_m2, heading_rad2 in np.diff(odom_variance, axis=0, prepend=np.nan).tolist():
        if position_m2 > 0 and heading_rad2 > 0:
            variances.append((position_m2, heading_rad2))
        else:
            variances.append(None)
    return variances
