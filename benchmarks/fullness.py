"""How full scans and their views are: the same figures for recorded and simulated logs.

`python -m benchmarks.fullness LOG …` prints them side by side: a LOG is a world's yaml, KITTI's
folder of a sequence with poses, the folder of NCLT's key frames, or one scan of either. A log is
read in stretches of scans that follow each other: the bird-view is of the octree over a whole
stretch, everything else of its last scan alone.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.core.frames import transformed
from pipeline.formats import nclt
from pipeline.mapping.octree import Octree
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.views.birdview import BirdView
from pipeline.views.scan_context import ScanContext
from worlds.simulation import Simulation

STRETCHES = 12
"""Stretches of a log, spread evenly over it; each figure is their mean."""
SCANS = 16
"""Scans of a stretch."""
KITTI_HEIGHT_M = 1.73
NCLT_HEIGHT_M = 0.957
KEY_FRAMES_LIFT_M = 0.78
KEY_FRAMES_YAW_DEG = 90.0
HEIGHTS_M = (0.3, 1.0, 2.0, 3.0, 5.0)
"""Borders of the histogram of heights above the ground."""
AUTHORS = ScanContext()
PAPER = ScanContext(voxel_m=0.0, min_points=1, beyond="drop")

Scan = tuple[NDArray[np.floating], NDArray[np.float64]]
"""Points (n, 3) of the vehicle's frame, whose origin lies on the ground; and its pose (4, 4)."""


@dataclass(frozen=True)
class Log:
    """Stretches of scans, and the height of the sensor above the vehicle's origin."""

    name: str
    stretches: list[list[Scan]]
    sensor_m: float


def figures(log: Log) -> dict[str, float]:
    """The mean of each figure over the stretches of a log."""
    rows = [_of_a_stretch(scans, log.sensor_m) for scans in log.stretches]
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _of_a_stretch(scans: list[Scan], sensor_m: float) -> dict[str, float]:
    wide = BirdView(Octree(sensor_height_m=sensor_m))
    near = BirdView(Octree(edge_m=30.0, sensor_height_m=sensor_m))
    octree_map = wide.octree.grow()
    for points_m, pose in scans:
        octree_map.insert(points_m, pose)
    last_m, last = scans[-1]
    image = wide.draw(octree_map, wide.standing(last_m, last))[0]
    alone = wide(last_m)[0]
    near_alone = near(last_m)[0]
    above_m = heights_m(wide, last_m)
    contexts = {"": AUTHORS(last_m), ", paper": PAPER(last_m)}
    edges_m = (-np.inf, *HEIGHTS_M, np.inf)
    shares = np.histogram(above_m, edges_m)[0] / len(above_m)
    fullness = {
        "points": float(len(last_m)),
        ".3-5 m": float(shares[1:5].sum()),
        "50 m light": image.mean() / 255,
        "50 m lit": float((image > 0).mean()),
        "one scan, 50 m light": alone.mean() / 255,
        "one scan, 50 m lit": float((alone > 0).mean()),
        "30 m light": near_alone.mean() / 255,
        "30 m lit": float((near_alone > 0).mean()),
    }
    for rule, bins in contexts.items():
        fullness[f"bins{rule}"] = float((bins != 0).mean())
        fullness[f"columns{rule}"] = float((bins != 0).any(0).mean())
    names = ["< .3", ".3-1", "1-2", "2-3", "3-5", "> 5"]
    return fullness | {name: float(share) for name, share in zip(names, shares, strict=True)}


def heights_m(view: BirdView, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """Heights (n,) of points (n, 3) above the ground plane that a view finds in them."""
    ground = view.standing(points_m, np.eye(4))
    return np.asarray((points_m - ground[:3, 3]) @ ground[:3, 2])


def table(logs: Iterator[Log]) -> Iterator[str]:
    """A Markdown table, a row a log, one line after the other."""
    for number, log in enumerate(logs):
        row = figures(log)
        if number == 0:
            yield "| | " + " | ".join(row) + " |"
            yield "|---" * (len(row) + 1) + "|"
        yield f"| {log.name} | " + " | ".join(map(_short, row.values())) + " |"


def _short(value: float) -> str:
    return f"{value:.0f}" if value > 2 else f"{value:.3f}"


def read(word: str) -> Log:
    """The log that a word names.

    A world is named by its yaml; a recorded log by KITTI's folder of a sequence, by the folder of
    NCLT's key frames, or by one scan in the format of either.
    """
    path = Path(word)
    if path.suffix == ".yaml":
        return simulated(path)
    if path.suffix == ".bin":
        return single(path)
    return key_frames(path) if (path / "keyframes.txt").is_file() else kitti(path)


def single(path: Path) -> Log:
    """One scan, of velodyne_sync if it lies in such a folder, else of KITTI."""
    if path.parent.name == "velodyne_sync":
        points_m = nclt.decode(np.fromfile(path, np.uint16))
        return Log(f"NCLT {path.stem}", [[(points_m, np.eye(4))]], NCLT_HEIGHT_M)
    points_m = read_velodyne(path, KITTI_HEIGHT_M)
    return Log(f"KITTI {path.parent.name} {path.stem}", [[(points_m, np.eye(4))]], KITTI_HEIGHT_M)


def kitti(path: Path) -> Log:
    """A sequence of KITTI odometry: all scans up to three of them, of which the last is one."""
    opened = Kitti(KITTI_HEIGHT_M).open(path.parents[1], path.name)
    count = len(opened.stamps_ns)
    scans = [(opened.points(row), opened.world_T_scan[row]) for row in range(count)]
    ends = sorted({1, count // 3 + 1, count})
    return Log(f"KITTI {path.name}", [scans[:end] for end in ends], KITTI_HEIGHT_M)


def key_frames(path: Path) -> Log:
    """NCLT's key frames, about a metre apart and thinned."""
    reader = KeyFrames(
        body_T_lidar=(0.0, 0.0, 0.0, 0.0, 0.0, KEY_FRAMES_YAW_DEG), lift_m=KEY_FRAMES_LIFT_M
    )
    opened = reader.open(path.parent, path.name)
    stretches = [
        [(opened.points(row), opened.world_T_scan[row]) for row in range(start, start + SCANS)]
        for start in np.linspace(0, len(opened.stamps_ns) - SCANS, STRETCHES).astype(int)
    ]
    return Log("NCLT key frames", stretches, NCLT_HEIGHT_M)


def simulated(path: Path) -> Log:
    """The world of a yaml in conf/world, which need not be recorded."""
    settings = yaml.safe_load(path.read_text(encoding="utf-8"))
    del settings["_target_"]
    return stretched(f"simulated {path.stem}", Simulation(**settings), STRETCHES // 2, SCANS)


def stretched(name: str, world: Simulation, stretches: int, scans: int) -> Log:
    """This many stretches from each of the first and the last sequence in a world's table."""
    gathered: list[list[Scan]] = []
    for sequence in dict.fromkeys((world.training, list(world.sequences)[-1])):
        recorder = world.recorder(sequence)
        sensor = recorder.lidar.body_T_sensor
        poses = recorder.drive.world_T_body[recorder.drive.scan_rows]
        for start in np.linspace(0, len(poses) - scans, stretches).astype(int).tolist():
            returns = recorder.block(start, start + scans)[1]
            gathered.append(
                [(transformed(sensor, scan.points_m), poses[row]) for row, _, scan in returns]
            )
    return Log(name, gathered, float(sensor[2, 3]))


if __name__ == "__main__":
    for line in table(map(read, sys.argv[1:])):
        print(line, flush=True)
