"""A scan into the dynamic octree, against OctoMap's C++ (through pyoctomap) at the same leaves and
range; and 16 bird-views.

With KITTI's first 16 scans where `YEARLOC_KITTI` names a KITTI root; else simulated scans, and the
race's name says so. OctoMap races where pyoctomap can be imported: no dependency of this project.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.race import Race, race
from benchmarks.scan_context import scans
from pipeline.core.frames import moved
from pipeline.mapping.octree import Octree, OctreeMap
from pipeline.readers.kitti import Kitti
from pipeline.views.birdview import BirdView

SCANS = 6
"""In a row: a map is not alone in a cold cache."""
Drive = list[tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Points (n, 3), vehicle frame, and the pose (4, 4) of each scan."""


def drive() -> tuple[str, Drive]:
    """The input of the races: 16 scans, about 0.9 m apart."""
    root = Path(os.environ.get("YEARLOC_KITTI", ""))
    if "YEARLOC_KITTI" in os.environ:
        log = Kitti().open(root, "00")
        return "KITTI 00", [
            (np.asarray(log.points(row), np.float64), log.world_T_scan[row]) for row in range(16)
        ]
    simulated = []
    for number, points in enumerate(scans()):
        pose = np.eye(4)
        pose[:2, 3] = 0.9 * number + 0.01, 0.02
        simulated.append((points.astype(np.float64), pose))
    return "simulated scans", simulated


def octomap(octree: Octree, discretize: bool, recorded: Drive) -> Callable[[int], object]:
    """OctoMap's own insertion into a new tree, of points already in the world's frame."""
    pyoctomap = import_module("pyoctomap")
    world = [np.ascontiguousarray(moved(pose, points)) for points, pose in recorded]
    sensors = [
        pose[:3, 3] + pose[:3, :3] @ (0.0, 0.0, octree.sensor_height_m) for _, pose in recorded
    ]

    def insert(_: int) -> None:
        tree = pyoctomap.OcTree(octree.leaf_m)
        tree.setProbHit(octree.hit)
        tree.setProbMiss(octree.miss)
        tree.setClampingThresMin(octree.lowest)
        tree.setClampingThresMax(octree.highest)
        for points, sensor in zip(world, sensors, strict=True):
            tree.insertPointCloud(points, sensor, max_range=octree.reach_m, discretize=discretize)

    return insert


def _into(grown: OctreeMap, recorded: Drive) -> Callable[[int], object]:
    """All scans into the map that there is: it decays, and its window follows."""

    def insert(_: int) -> None:
        for points, pose in recorded:
            grown.insert(points, pose)

    return insert


LARGE = Octree(edge_m=102.4, depth=9)
"""±51.2 m in leaves of 0.2 m."""


def run() -> list[Race]:
    """One thread; scans in the order of the drive."""
    name, recorded = drive()
    spaces = Octree(), Octree(depth=8), LARGE, replace(LARGE, max_range_m=30.0)
    return [
        *(_insertion(name, recorded, octree) for octree in spaces),
        _sweeps(recorded),
        _drawing(recorded),
    ]


def _insertion(name: str, recorded: Drive, octree: Octree) -> Race:
    """All candidates cut rays at the same range, `reach_m`; ours end at the root cube too, which
    the peers do not have."""
    short = recorded[:SCANS]
    grown = octree.grow()
    candidates = {
        "yearloc, a ray a cell": _into(grown, short),
        "yearloc, all rays": _into(replace(octree, rays="all").grow(), short),
    }
    note = "OctoMap not raced: pyoctomap is not installed"
    if find_spec("pyoctomap"):
        note = (
            _agree(replace(octree, motion="none"), recorded)
            if octree.depth < 9
            else "states not compared"
        )
        candidates["OctoMap, discretised: a ray a cell"] = octomap(octree, True, short)
        candidates["OctoMap, all rays"] = octomap(octree, False, short)
    size = (
        f"{len(short)} scans into leaves of {octree.leaf_m:.2f} m, {octree.edge_m:g} m around the "
        "robot"
    )
    raced = race(
        f"{size}, rays of at most {octree.reach_m:.1f} m for all, {name} ({note})",
        candidates,
        rounds=3,
    )
    return replace(raced, name=f"{raced.name}; our map has {grown.bricks.nbytes / 1e6:.1f} MB")


def _agree(octree: Octree, recorded: Drive) -> str:
    """Compare a map of one scan with OctoMap's at a sample of the window's leaves."""
    pyoctomap = import_module("pyoctomap")
    points, pose = recorded[5]
    grown = octree.grow()
    tree = pyoctomap.OcTree(octree.leaf_m)
    grown.insert(points, pose)
    sensor = pose[:3, 3] + pose[:3, :3] @ (0.0, 0.0, octree.sensor_height_m)
    world = np.ascontiguousarray(moved(pose, points))
    tree.insertPointCloud(world, sensor, max_range=octree.reach_m, discretize=True)
    log_odds = grown.log_odds
    cells = np.argwhere(log_odds != 0)[::7]
    middles = grown.corner_m + (cells + 0.5) * grown.leaf_m
    nodes = [tree.search(middle.tolist()) for middle in middles]
    same = [
        node is not None and (node.getLogOdds() > 0) == (log_odds[tuple(cell)] > 0)
        for node, cell in zip(nodes, cells, strict=True)
    ]
    if np.mean(same) < 0.999:
        raise AssertionError(f"only {np.mean(same):.2%} of the leaves are in OctoMap's state")
    return f"{np.mean(same):.2%} of {len(same):,} leaves in OctoMap's state"


def _sweeps(recorded: Drive) -> Race:
    octree = Octree()
    grown = octree.grow()
    sweeps = [(points[::220], pose) for points, pose in recorded]
    leaves = grown.log_odds
    copy = np.empty_like(leaves)
    return race(
        "a sweep of some 540 points into the same map",
        {
            "yearloc": lambda i: grown.insert(*sweeps[i % 16]),
            "memcpy of a dense cube of leaves": lambda _: np.copyto(copy, leaves),
        },
        rounds=100,
    )


def _drawing(recorded: Drive) -> Race:
    view = BirdView()
    grown = view.octree.grow()
    for points, pose in recorded:
        grown.insert(points, pose)
    here = recorded[-1][1]
    return race(
        "16 bird-views of 64 × 64", {"yearloc": lambda i: view.draw(grown, here, i)}, rounds=40
    )


if __name__ == "__main__":
    for result in run():
        print(result.table())
