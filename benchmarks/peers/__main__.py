"""Our side of the races, with the peers' command lines: `python -m benchmarks.peers draw|… …`."""

import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import given
from pipeline.mapping.octree import Octree
from pipeline.matching.nearest import nearest
from pipeline.matching.shift_method import ring_keys
from pipeline.matching.shifts import Spectra
from pipeline.views.m2dp import M2dp
from pipeline.views.scan_context import ScanContext

ROUNDS = 6
Scoring = Callable[
    [NDArray[np.float32]], NDArray[np.float32]
]  # heights (1, rings, sectors) in metres to scores (1, places)


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


def m2dp(points: str, scans: str, out: str) -> tuple[float, ...]:
    """Signatures of scans."""
    clouds = np.fromfile(points, "<f4").reshape(int(scans), -1, 3)
    view = M2dp()
    np.stack([view(cloud) for cloud in clouds]).astype("<f4").tofile(out)
    return (median_ms(lambda i: view(clouds[i]), len(clouds)),)


def seqslam(images: str, rows: str, out: str) -> tuple[float, ...]:
    """The match of each image of a drive in another."""
    references, queries = np.fromfile(images, np.uint8).reshape(2, int(rows), -1)
    matched = np.full(int(rows), -1, "<i4")
    half = given.HALF_SEQUENCE
    matched[half:-half] = given.matched(references, queries)
    matched.tofile(out)
    return (median_ms(lambda _: given.matched(references, queries), 1),)


def export(network: str) -> tuple[float, ...]:
    """Write SCI's network as `yearloc export` does."""
    from pipeline.online.export import exported

    Path(network).write_bytes(exported(*given.sci())[0])
    return ()


def answer(network: str, images: str, rows: str, out: str, by: str) -> tuple[float, ...]:
    """The scores of that network's places for each image, by `torch` or by `onnxruntime`."""
    heights = np.fromfile(images, "<f4").reshape(int(rows), 1, given.RINGS, given.SECTORS)
    ask = torch_scores() if by == "torch" else onnx_scores(Path(network))
    np.concatenate([ask(image) for image in heights]).astype("<f4").tofile(out)
    return (median_ms(lambda i: ask(heights[i]), len(heights)),)


def torch_scores() -> Scoring:
    """At the precision of `precision: auto`."""
    import torch

    from pipeline.networks import lenet, loop
    from pipeline.online.export import Scores

    method, model = given.sci()
    net = method.filled(model).eval()
    loop.cast(net, lenet.device(), method.precision)
    torch.set_num_threads(1)
    scores = Scores(method, net)

    def ask(image: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.inference_mode():
            return np.asarray(scores(torch.from_numpy(image))[0])

    return ask


def onnx_scores(network: Path) -> Scoring:
    from pipeline.online.runtime import CLASSIFIED, INPUT, session

    run = session(network.read_bytes())
    return lambda image: np.asarray(run.run([CLASSIFIED[0]], {INPUT: image})[0])


def search(images: str, rows: str, queries: str, out: str, candidates: str) -> tuple[float, ...]:
    """The nearest of all rows, or of as many candidates by ring key, to each query."""
    heights = np.fromfile(images, "<f4").reshape(-1, given.RINGS, given.SECTORS)
    database = heights[: int(rows)]
    query_heights = heights[int(rows) :]
    k = int(candidates)
    spectra = Spectra.learned(database)
    keys = ring_keys(database)
    everything = np.arange(len(database))

    def find(i: int) -> tuple[int, float]:
        among = (
            nearest(keys, ring_keys(query_heights[i, None]), k)[1][0]
            if k
            else spectra.likely(query_heights[i], everything, 1)
        )
        distances, _ = spectra.compare(query_heights[i], among)
        return among[distances.argmin()], distances.min()

    np.array([find(i) for i in range(int(queries))], "<f4").tofile(out)
    return (median_ms(find, int(queries)),)


def octree(
    points: str, scans: str, origins: str, leaf_m: str, range_m: str, depth: str
) -> tuple[float, ...]:
    """Insert all scans into one map several times, as the peers do: time a scan, and megabytes."""
    sensors = np.fromfile(origins, "<f4").reshape(-1, 1, 3).astype(np.float64)
    clouds = np.fromfile(points, "<f4").reshape(int(scans), -1, 3) - sensors
    recipe = Octree(
        edge_m=float(leaf_m) * 2 ** int(depth),
        depth=int(depth),
        motion="none",
        max_range_m=float(range_m),
        sensor_height_m=0.0,
    )
    octree_map = recipe.grow()
    poses = np.tile(np.eye(4), (len(clouds), 1, 1))
    poses[:, :3, 3] = sensors[:, 0]

    def insert(_: int) -> None:
        for cloud, pose in zip(clouds, poses, strict=True):
            octree_map.insert(cloud, pose)

    return median_ms(insert, 1) / len(clouds), octree_map.bricks.nbytes * 1e-6


def main(words: Sequence[str]) -> None:
    kind, *rest = words
    commands = (draw, m2dp, search, seqslam, export, answer, octree)
    print(*next(each for each in commands if each.__name__ == kind)(*rest))


if __name__ == "__main__":
    main(sys.argv[1:])
