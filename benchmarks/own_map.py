"""What a judge without a survey says of a study on estimated poses, and what the survey says.

    yearloc use campus world=demo budget=minutes methods=sci_ring poses=slam,sci_ring latency=no
    yearloc repro
    python -m benchmarks.own_map artifacts campus 10m sci_ring

Of the simulated campus, whose logs hold the true poses, which no stage of that study read. One
rigid transform of the training day lays its map on the truth; nothing else of it is moved.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.slam import laid
from pipeline.core import schemas, store
from pipeline.core.frames import Poses, Stamps, distance_and_turn
from pipeline.readers.nclt import Nclt
from pipeline.studies.layout import Layout

SEEN_M = 5.0
"""A query is seen whose pose lies so near to one of training."""
WITHIN_M = 15.0
RIGHT_M = 2.0
RIGHT_DEG = 5.0
PROMISE = 0.99
HEAD = (
    "| test day | judged by | own poses off m | seen | within 15 m | right poses | accepted "
    "| wrong of these |\n|" + "---|" * 8
)


def main(artifacts: Path, dataset: str, grid: str, model: str) -> None:
    layout = Layout(artifacts)
    poses_folder = layout.path("poses", dataset, grid, model)
    tests = sorted(path.stem for path in poses_folder.glob("*.zarr"))
    first = store.read(poses_folder / f"{tests[0]}.zarr", schemas.Fixes)
    train_name = _train(layout, dataset, tests)
    train = _submaps(layout, dataset, train_name)
    train_true = _true(layout, dataset, train_name, train.stamps_ns)
    true_T_world = laid(train.world_T_anchor, train_true)
    promise = list(first.promises).index(PROMISE)
    print(HEAD)
    for day in tests:
        submaps = _submaps(layout, dataset, day)
        true = _true(layout, dataset, day, submaps.stamps_ns)
        off_m = distance_and_turn(true_T_world @ submaps.world_T_anchor, true)[0]
        ranking = store.read(layout.path("localize", dataset, grid, model, day), schemas.Rankings)
        fixes = store.read(layout.path("poses", dataset, grid, model, day), schemas.Fixes)
        accepted = fixes.novelty[:, 0] < fixes.promised[promise]
        xy_m = np.column_stack([ranking.xy_m[:, 0], 0 * accepted, 1 + 0 * accepted])
        for judge, query, known, move in (
            ("own map", submaps.world_T_anchor, train.world_T_anchor, np.eye(4)),
            ("survey", true, train_true, true_T_world),
        ):
            away_m = np.linalg.norm((xy_m @ move.T)[:, :2] - query[:, :2, 3], axis=1)
            pose_m, pose_deg = distance_and_turn(move @ fixes.world_T_query, query)
            right = (pose_m < RIGHT_M) & (pose_deg < RIGHT_DEG)
            seen = _nearest_m(query, known) < SEEN_M
            rms_m = np.sqrt((off_m**2).mean())
            numbers = (
                f"{rms_m:.2f}" if judge == "survey" else "–",
                int(seen.sum()),
                f"{(away_m[seen] < WITHIN_M).mean():.3f}",
                f"{right[seen].mean():.3f}",
                int(accepted.sum()),
                int((accepted & ~right).sum()),
            )
            print(f"| {day} | {judge} | {' | '.join(map(str, numbers))} |")


def _train(layout: Layout, dataset: str, tests: list[str]) -> str:
    days = {path.stem for path in layout.path("submaps", dataset).glob("*.zarr")}
    return next(iter(sorted(days - set(tests))))


def _submaps(layout: Layout, dataset: str, day: str) -> schemas.Submaps:
    return store.read(layout.path("submaps", dataset, day), schemas.Submaps)


def _true(layout: Layout, dataset: str, day: str, stamps_ns: Stamps) -> Poses:
    """The surveyed poses (n, 4, 4) at stamps (n,)."""
    log = Nclt(max_gap_s=3.0).open(layout.path("logs", dataset), day)
    return log.world_T_scan[np.searchsorted(log.stamps_ns, stamps_ns)]


def _nearest_m(query: Poses, known: Poses) -> NDArray[np.float64]:
    """Metres (n,) from each pose to the nearest known one."""
    away_m = np.linalg.norm(query[:, None, :2, 3] - known[None, :, :2, 3], axis=2)
    return np.asarray(away_m.min(axis=1))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:5])
