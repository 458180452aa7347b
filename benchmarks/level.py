"""Poses from level lasers in recorded buildings, and what their verdict is worth.

`python -m benchmarks.level CARMEN [--logs intel,fhw] [--shares .4,.5] [--queries 50]` maps the
first 40 % of the sweeps of each log, and then the first half, by their corrected poses, and
localises sweeps of the rest, evenly chosen, each gathered over the raw odometry before it (ODOM
lines). CARMEN is a folder of NAME-corrected.log.gz. A row a map: square metres that are free; the
share of queries that were seen (the map's path within 2 m); of these the share that is right
(within 1 m and 10°), by the fix and by the baseline: the best cell of a single sweep in the same
likelihood field, as an exhaustive search finds it, since branch and bound is exact; then for .95
and .99 the share of all queries that is accepted, of the seen ones, and how many of the accepted
are wrong; CPU time of one thread from points to fix, median and 95 %.

Chances and limits are verdict.USUAL and USUAL_LIMITS, the limits lowered where held-out stretches
of the mapped part say so; queries have no part in them. `--usual` prints these two anew, from
held-out stretches of the first halves of TUNED alone.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.level.field import Field
from pipeline.level.fix import LevelFix, LevelFixer
from pipeline.level.held_out import LevelHeldOut, Sweeps
from pipeline.level.level_map import Drawing
from pipeline.level.search import search
from pipeline.level.sweeps import Gatherer, single
from pipeline.level.verdict import LevelEvidence, LevelVerdict, pose_is_right
from pipeline.online.level_pack import OVER_M, UNSEEN_SHARE
from pipeline.posing.verdict import BELIEFS, PROMISES
from pipeline.readers.carmen import Carmen

LOGS = ("intel", "fhw", "seattle", "csail", "aces", "freiburg-101", "freiburg-campus")
TUNED = ("intel", "fhw", "seattle")
"""Whatever was chosen by looking was chosen on these."""
SHARES = (0.4, 0.5)
SEEN_M = 2.0
HELD_OUT = 24
"""Held-out stretches of a map at most."""
PROMISED = (0.95, 0.99)
HEADER = (
    f"{'log':<16}{'mapped':>7}{'free m²':>9}{'asked':>6}{'seen':>6}{'right':>7}{'single':>7}"
    + "".join(f"  {promise:>4}: all  seen  wrong" for promise in PROMISED)
    + f"{'ms':>7}{'95 %':>6}"
)


@dataclass(frozen=True)
class Trial:
    """A log whose first part was mapped, and whose other part was asked."""

    name: str
    share: float
    free_m2: float
    evidence: LevelEvidence
    fixes: Sequence[LevelFix]
    single: NDArray[np.float64]
    """(query, 4, 4) the best cell of a single sweep."""
    world_T_true: NDArray[np.float64]
    """(query, 4, 4)."""
    seen: NDArray[np.bool_]
    """(query,)."""
    ms: NDArray[np.float64]
    """(query,) CPU time from points to fix, matching of the newest sweep included."""


def read(folder: Path, name: str) -> Sweeps:
    """The sweeps of a log."""
    log = Carmen().open(folder, f"{name}-corrected")
    return Sweeps(log.points, log.world_T_scan, log.odom_T_scan)


def evidence(sweeps: Sweeps, share: float, most: int) -> tuple[LevelEvidence, Drawing]:
    """What held-out stretches of the first part of a log say, and its drawing."""
    mapped = sweeps.part(0, int(share * len(sweeps.world_T_sweep)))
    hits = [mapped.points(row) for row in range(len(mapped.world_T_sweep))]
    drawing = Drawing.of(hits, mapped.world_T_sweep)
    return LevelHeldOut(most=most).evidence(LevelFixer(), mapped, drawing, OVER_M), drawing


def trial(sweeps: Sweeps, name: str, share: float, queries: int) -> Trial:
    """Map the first part of a log and ask for sweeps of the rest."""
    held_out, drawing = evidence(sweeps, share, HELD_OUT)
    level_map = drawing.level_map()
    field = Field.of(level_map)
    first = int(share * len(sweeps.world_T_sweep))
    asked = sweeps.part(first, len(sweeps.world_T_sweep))
    count = len(asked.world_T_sweep)
    rows = np.unique(np.linspace(0, count - 1, min(queries, count)).round().astype(int))
    fixer = LevelFixer()
    fixer.fix(field, single(asked.points(0)))  # compiles kernels
    gatherer = Gatherer()
    fixes = []
    ms = []
    cells = []
    for row in range(count):
        points_m = np.asarray(asked.points(row), np.float64)
        start = time.process_time()
        gatherer.add(points_m, asked.step(row))
        if row in rows:
            fixes.append(fixer.fix(field, gatherer.gathered(OVER_M)))
            ms.append(1e3 * (time.process_time() - start))
            best = search(field, single(points_m).points_m, keep=1).poses
            cells.append(_pose(field, best[0]) if len(best) else np.full((4, 4), np.nan))
    true = asked.world_T_sweep[rows]
    path_m = sweeps.world_T_sweep[:first, :2, 3]
    away_m = np.linalg.norm(true[:, None, :2, 3] - path_m, axis=2).min(axis=1)
    return Trial(
        name,
        share,
        level_map.free_m2,
        held_out,
        fixes,
        np.array(cells),
        true,
        away_m < SEEN_M,
        np.array(ms),
    )


def _pose(field: Field, grid_pose: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    cos, sin = np.cos(grid_pose[2]), np.sin(grid_pose[2])
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    pose[:2, 3] = grid_pose[:2]
    return np.asarray(field.world_T_grid @ pose)


def row(result: Trial) -> tuple[str, list[float]]:
    """The row of a trial, and its numbers for the means."""
    verdict = LevelVerdict(result.evidence, UNSEEN_SHARE)
    limits = dict(zip(PROMISES, verdict.limits("fix"), strict=True))
    fixes = [fix.ordered(verdict.judge.pose) for fix in result.fixes]
    doubts = np.array([verdict.judge.doubts(fix)[0] for fix in fixes]).astype(np.float32)
    nowhere = np.full((4, 4), np.nan)
    poses = np.array(
        [fix.hypotheses[0].world_T_query if fix.hypotheses else nowhere for fix in fixes]
    )
    good = pose_is_right(poses, result.world_T_true)
    good_single = pose_is_right(result.single, result.world_T_true)
    seen = result.seen
    numbers = [float(seen.mean()), float(good[seen].mean()), float(good_single[seen].mean())]
    text = f"{result.name:<16}{result.share:>7.2f}{result.free_m2:>9,.0f}{len(good):>6}"
    text += f"{numbers[0]:>6.2f}{numbers[1]:>7.3f}{numbers[2]:>7.3f}"
    for promise in PROMISED:
        accepted = doubts < limits[promise]
        wrong = int((accepted & ~good).sum())
        numbers += [float(accepted.mean()), float(accepted[seen].mean()), wrong, accepted.sum()]
        text += (
            f"{accepted.mean():>11.2f}{accepted[seen].mean():>6.2f}{wrong:>3}/{accepted.sum():<3}"
        )
    numbers += [float(np.median(result.ms)), float(np.quantile(result.ms, 0.95))]
    return f"{text}{numbers[-2]:>7.0f}{numbers[-1]:>6.0f}", numbers


def usual(folder: Path) -> None:
    """Print the usual chances and limits, learned anew."""
    parts = [evidence(read(folder, name), 0.5, 150)[0] for name in TUNED]
    joined = LevelEvidence.joined(parts)
    judge = LevelVerdict(joined, UNSEEN_SHARE).learned()
    verdict = LevelVerdict(joined, UNSEEN_SHARE, judge)
    print(f"{joined.blocks} held-out stretches of {', '.join(TUNED)}")
    print(judge)
    print({belief: verdict.reached(belief) for belief in BELIEFS})


def main() -> None:
    parser = argparse.ArgumentParser("python -m benchmarks.level", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", default=",".join(LOGS))
    parser.add_argument("--shares", default=",".join(map(str, SHARES)))
    parser.add_argument("--queries", type=int, default=50)
    parser.add_argument("--usual", action="store_true")
    options = parser.parse_args()
    if options.usual:
        usual(options.folder)
        return
    print(HEADER, flush=True)
    rows: list[list[float]] = []
    for name in options.logs.split(","):
        for share in map(float, options.shares.split(",")):
            text, numbers = row(trial(read(options.folder, name), name, share, options.queries))
            print(text, flush=True)
            rows.append(numbers)
    means = np.mean(rows, axis=0)
    answered = ", ".join(
        f"{means[3 + 4 * number]:.2f} of all and {means[4 + 4 * number]:.2f} of the seen at "
        f"{promise}, wrong {sum(each[5 + 4 * number] for each in rows):.0f} of "
        f"{sum(each[6 + 4 * number] for each in rows):.0f}"
        for number, promise in enumerate(PROMISED)
    )
    print(
        f"in the mean of maps: right of seen {means[1]:.3f}, single sweep {means[2]:.3f}; accepted "
        f"{answered}"
    )


if __name__ == "__main__":
    main()
