"""Ours, with the words that the peers' programs take: `python -m benchmarks.peers draw|search|octree …`."""

import statistics
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np

from pipeline.mapping.octree import Octree
from pipeline.matching.nearest import nearest
from pipeline.matching.shift_method import ring_keys
from pipeline.matching.shifts import Spectra
from pipeline.views.scan_context import ScanContext

RINGS, SECTORS, ROUNDS = 40, 120, 6


def median_ms(call: Callable[[int], object], inputs: int) -> float:
    """CPU time of a call, which gets the number of its input; the first inputs are taken twice."""
    call(0)
    took = []
    for number in range(ROUNDS * inputs):
        start = time.process_time_ns()
        call(number % inputs)
        took.append((time.process_time_ns() - start) / 1e6)
    return statistics.median(took)


def draw(points: str, scans: str, out: str) -> tuple[float, ...]:
    """Images of scans."""
    clouds = np.fromfile(points, "<f4").reshape(int(scans), -1, 3)
    view = ScanContext(voxel_m=0.0, min_points=1)
    np.stack([view(cloud) for cloud in clouds]).tofile(out)
    return (median_ms(lambda i: view(clouds[i]), len(clouds)),)


def search(images: str, rows: str, queries: str, out: str, candidates: str) -> tuple[float, ...]:
    """The nearest of all rows, or of as many candidates by ring key, to each query."""
    heights = np.fromfile(images, "<f4").reshape(-1, RINGS, SECTORS)
    known, asked, k = heights[: int(rows)], heights[int(rows) :], int(candidates)
    spectra, keys, everything = Spectra.learned(known), ring_keys(known), np.arange(len(known))

    def find(i: int) -> tuple[int, float]:
        among = nearest(keys, ring_keys(asked[i, None]), k)[1][0] if k else spectra.likely(asked[i], everything, 1)
        distances, _ = spectra.compare(asked[i], among)
        return among[distances.argmin()], distances.min()

    np.array([find(i) for i in range(int(queries))], "<f4").tofile(out)
    return (median_ms(find, int(queries)),)


def octree(points: str, scans: str, origins: str, leaf_m: str, range_m: str, depth: str) -> tuple[float, ...]:
    """All scans into one map, again and again as the peers do: its time a scan, and its megabytes."""
    sensors = np.fromfile(origins, "<f4").reshape(-1, 1, 3).astype(np.float64)
    clouds = np.fromfile(points, "<f4").reshape(int(scans), -1, 3) - sensors
    recipe = Octree(
        edge_m=float(leaf_m) * 2 ** int(depth), depth=int(depth), motion="none", max_range_m=float(range_m), sensor_height_m=0.0
    )
    grown, poses = recipe.grow(), np.tile(np.eye(4), (len(clouds), 1, 1))
    poses[:, :3, 3] = sensors[:, 0]

    def insert(_: int) -> None:
        for cloud, pose in zip(clouds, poses, strict=True):
            grown.insert(cloud, pose)

    return median_ms(insert, 1) / len(clouds), grown.bricks.nbytes * 1e-6


def main(words: Sequence[str]) -> None:
    kind, *given = words
    commands: dict[str, Callable[..., tuple[float, ...]]] = {"draw": draw, "search": search, "octree": octree}
    print(*commands[kind](*given))


if __name__ == "__main__":
    main(sys.argv[1:])
