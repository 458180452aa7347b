"""Poses from level lasers in recorded buildings, and what their verdict is worth.

`python -m benchmarks.level CARMEN [--logs intel,fhw] [--shares .4,.5] [--queries 50]` maps the
first 40 % of the sweeps of each log, and then the first half, by their corrected poses, and
localises sweeps of the rest, evenly chosen, each gathered over the raw odometry before it (ODOM
lines). CARMEN is a folder of NAME-corrected.log.gz, as `yearloc fetch carmen` writes it. It prints
the table of docs/how-to/level.md, a row a map: square metres that are free; the share of queries
that were seen (the map's path within 2 m); of these the share that is right (within 1 m and 10°),
by the fix and by two baselines: the best cell of a single sweep in the same likelihood field, as
an exhaustive search finds it, since branch and bound is exact, and ICP (Besl and McKay, PAMI 1992)
of the sweep from there; then for the target precisions .95 and .99 the accepted share of all
queries and of the seen queries, how many accepted poses are wrong, and how many of these `by the
log`, whose other sweeps contradict the log's own pose; and CPU time of one thread from points to
verdict, median and 95 %.

Probabilities and thresholds are verdict.USUAL and USUAL_THRESHOLDS; a threshold is lowered if
validation stretches of the mapped part require it. Queries have no part in them. `--usual` learns
these two again, from validation stretches of the first halves of TUNED alone, and prints them.

`--kidnapped FILE.gif` draws instead how a robot is lost and found again: it follows the second half
of a log by its odometry. In the middle it is carried over CARRIED sweeps, which the odometry does
not contain.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.progress import Progress
from pipeline.formats import nav2_map
from pipeline.formats.nav2_map import GridMap
from pipeline.level.day import LevelDay
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.search import mean_likelihoods, search
from pipeline.level.sweeps import OVER_M, Gatherer, single
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.level.verdict import OF_SWEEPS, USUAL
from pipeline.online.level_pack import UNSEEN_SHARE, pack_map
from pipeline.online.level_site import LevelSite
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from pipeline.posing.answers import PosedQuery
from pipeline.posing.verdict import TARGET_PRECISIONS, FixEvidence
from pipeline.readers.carmen import Carmen
from pipeline.report.figures import level_plan

LOGS = ("intel", "fhw", "seattle", "csail", "aces", "freiburg-101", "freiburg-campus")
TUNED = ("intel", "fhw", "seattle")
"""The logs on which settings were tuned by hand."""
SHARES = (0.4, 0.5)
SEEN_M = 2.0
VALIDATION = 24
"""The most validation stretches of a map."""
COMPARED_PRECISIONS = (0.95, 0.99)
COUNTS = 5
"""Numbers of a row for each of COMPARED_PRECISIONS."""
ICP_STEPS = 30
ICP_M = 1.0
"""Largest distance of a pair of hit and wall."""
LOG_M = 1.0
LOG_DEG = 20.0
LOG_OFF = 0.2
"""A log's pose is unreliable if another pose within LOG_M and LOG_DEG fits the sweep better by this
mean likelihood."""
CARRIED = 30
HEADER = (
    "log",
    "mapped",
    "free m²",
    "asked",
    "seen",
    "right of seen",
    "best cell",
    "ICP from it",
    *(
        f"at {target_precision:g}: of all, of seen, wrong"
        for target_precision in COMPARED_PRECISIONS
    ),
    "ms: median, 95 %",
)


@dataclass(frozen=True)
class Trial:
    """A log whose first part was mapped, and whose other part gave the queries."""

    name: str
    share: float
    day: LevelDay
    queries: Sequence[PosedQuery]
    cells: NDArray[np.float64]
    """(query, 4, 4) the best cell of a single sweep."""
    icp: NDArray[np.float64]
    """(query, 4, 4) the sweep registered from there."""
    world_T_true: NDArray[np.float64]
    """(query, 4, 4)."""
    seen: NDArray[np.bool_]
    """(query,)."""
    sweeps: Sweeps
    """All of the log."""
    rows: NDArray[np.int64]
    """(query,) the row of each query among these."""
    ms: NDArray[np.float64]
    """(query,) CPU time from points to verdict, matching of the newest sweep included."""


def read(folder: Path, name: str) -> Sweeps:
    """The sweeps of a log."""
    log = Carmen().open(folder, f"{name}-corrected")
    return Sweeps(log.points, log.world_T_scan, log.odom_T_scan)


def trial(sweeps: Sweeps, name: str, share: float, queries: int) -> Trial:
    """Map the first part of a log and localise sweeps of the rest."""
    first = int(share * len(sweeps.world_T_sweep))
    day = LevelDay.of(sweeps.part(0, first), UNSEEN_SHARE, LevelValidation(most=VALIDATION))
    asked = sweeps.part(first, len(sweeps.world_T_sweep))
    count = len(asked.world_T_sweep)
    rows = np.unique(np.linspace(0, count - 1, min(queries, count)).round().astype(int))
    walls = KDTree(np.argwhere(day.field.walls)[:, ::-1] * day.field.cell_m + day.field.cell_m / 2)
    day.query(single(asked.points(0)))  # compiles kernels
    gatherer = Gatherer()
    answers = []
    ms = []
    cells = []
    icp = []
    for row in range(count):
        points_m = np.asarray(asked.points(row), np.float64)
        start = time.process_time()
        gatherer.add(points_m, asked.step(row))
        if row in rows:
            answers.append(day.query(gatherer.gathered(OVER_M)))
            ms.append(1e3 * (time.process_time() - start))
            hits_m = single(points_m).points_m
            best = search(day.field, hits_m, keep=1).poses
            pose = best[0] if len(best) else np.full(3, np.nan)
            cells.append(_in_world(day.field, pose))
            icp.append(_in_world(day.field, registered(walls, hits_m, pose)))
    true = asked.world_T_sweep[rows]
    path_m = sweeps.world_T_sweep[:first, :2, 3]
    away_m = np.linalg.norm(true[:, None, :2, 3] - path_m, axis=2).min(axis=1)
    return Trial(
        name,
        share,
        day,
        answers,
        np.array(cells),
        np.array(icp),
        true,
        away_m < SEEN_M,
        sweeps,
        first + rows,
        np.array(ms),
    )


def registered(
    walls: KDTree, hits_m: NDArray[np.float64], pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The pose (3,) of hits (n, 2) after ICP, point to point, with the middles of wall cells."""
    if not np.isfinite(pose).all():
        return pose
    pose = pose.copy()
    for _ in range(ICP_STEPS):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        placed_m = hits_m @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
        distance_m, nearest = walls.query(placed_m, distance_upper_bound=ICP_M)
        paired = np.asarray(np.isfinite(distance_m))
        if paired.sum() < 3:
            break
        here_m = hits_m[paired]
        there_m = walls.data[np.asarray(nearest)[paired]]
        off_m = here_m - here_m.mean(axis=0)
        wanted_m = there_m - there_m.mean(axis=0)
        turn = np.arctan2(
            (off_m[:, 0] * wanted_m[:, 1] - off_m[:, 1] * wanted_m[:, 0]).sum(),
            (off_m * wanted_m).sum(),
        )
        cos, sin = np.cos(turn), np.sin(turn)
        at_m = there_m.mean(axis=0) - here_m.mean(axis=0) @ np.array([[cos, sin], [-sin, cos]])
        pose = np.array([*at_m, turn])
    return pose


def is_log_unreliable(sweeps: Sweeps, row: int) -> bool:
    """Whether a log's other sweeps contradict the pose that it gives one of them.

    Candidates are poses within LOG_M and LOG_DEG that differ by more than half of what counts as
    right. No fix is used.
    """
    count = len(sweeps.world_T_sweep)
    drawing = Drawing.of([sweeps.points(other) for other in range(count)], sweeps.world_T_sweep)
    field = Field.of(drawing.level_map(np.arange(count) == row))
    right_m, right_deg = OF_SWEEPS.right_within
    hits_m = single(sweeps.points(row)).points_m
    grid_T_sweep = np.linalg.inv(field.world_T_grid) @ sweeps.world_T_sweep[row]
    heading_rad = np.arctan2(grid_T_sweep[1, 0], grid_T_sweep[0, 0])
    steps_m = np.arange(-LOG_M, LOG_M + field.cell_m / 2, field.cell_m)
    off_m = np.stack(np.meshgrid(steps_m, steps_m), axis=-1).reshape(-1, 2)
    logged = np.array([[*grid_T_sweep[:2, 3], heading_rad]])
    least = mean_likelihoods(field, hits_m, logged)[0] + LOG_OFF
    for turn_deg in np.arange(-LOG_DEG, LOG_DEG + 0.5):
        turned = np.full((len(off_m), 1), heading_rad + np.deg2rad(turn_deg))
        poses = np.hstack([grid_T_sweep[:2, 3] + off_m, turned])
        is_other = np.linalg.norm(off_m, axis=1) > right_m / 2
        if abs(turn_deg) > right_deg / 2:
            is_other[:] = True
        if is_other.any() and mean_likelihoods(field, hits_m, poses[is_other]).max() > least:
            return True
    return False


def _in_world(field: Field, grid_pose: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    cos, sin = np.cos(grid_pose[2]), np.sin(grid_pose[2])
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    pose[:2, 3] = grid_pose[:2]
    return np.asarray(field.world_T_grid @ pose)


def numbers(result: Trial) -> list[float]:
    """The numbers of a row: shares, and for each of COMPARED_PRECISIONS COUNTS numbers.

    These are the accepted shares of all and of seen queries, and how many poses are wrong, are
    accepted, and are wrong while the log is unreliable.
    """
    thresholds = dict(
        zip(TARGET_PRECISIONS, result.day.verdict.claim_thresholds["fix"], strict=True)
    )
    errors = [query.error_probabilities[0] for query in result.queries]
    error_probability = np.array(errors, np.float32)
    good = OF_SWEEPS.right(np.array([query.pose for query in result.queries]), result.world_T_true)
    seen = result.seen
    values = [float(seen.mean()), float(good[seen].mean())]
    for poses in (result.cells, result.icp):
        values.append(float(OF_SWEEPS.right(poses, result.world_T_true)[seen].mean()))
    for target_precision in COMPARED_PRECISIONS:
        accepted = error_probability < thresholds[target_precision]
        wrong = accepted & ~good
        unreliable = sum(
            is_log_unreliable(result.sweeps, row) for row in result.rows[wrong].tolist()
        )
        shares = [float(accepted.mean()), float(accepted[seen].mean())]
        values += [*shares, int(wrong.sum()), int(accepted.sum()), unreliable]
    return [*values, float(np.median(result.ms)), float(np.quantile(result.ms, 0.95))]


def cells_of(values: Sequence[float]) -> list[str]:
    """The cells of a row, from the share of the seen on."""
    texts = [f"{values[0]:.2f}", *(f"{share:.3f}" for share in values[1:4])]
    for first in range(4, 4 + COUNTS * len(COMPARED_PRECISIONS), COUNTS):
        of_all, of_seen, wrong, accepted, unreliable = values[first : first + COUNTS]
        by_log = f" ({unreliable:.0f} by the log)" if unreliable else ""
        texts.append(f"{of_all:.2f} {of_seen:.2f} {wrong:.0f}/{accepted:.0f}{by_log}")
    return [*texts, f"{values[-2]:.0f}, {values[-1]:.0f}"]


def line(cells: Sequence[str]) -> str:
    """A row of a markdown table."""
    return f"| {' | '.join(cells)} |"


def table(folder: Path, logs: Sequence[str], shares: Sequence[float], queries: int) -> None:
    """Print the table, and in its last row means over the maps and sums of wrong and accepted."""
    print(line(HEADER))
    print(line(["---"] * len(HEADER)), flush=True)
    rows: list[list[float]] = []
    for name in logs:
        for share in shares:
            result = trial(read(folder, name), name, share, queries)
            rows.append(numbers(result))
            tuned = " (tuned on)" if name in TUNED else ""
            free_m2 = f"{result.day.level_map.free_m2:,.0f}"
            head = [f"{name}{tuned}", f"{share:.0%}", free_m2, str(len(result.ms))]
            print(line([*head, *cells_of(rows[-1])]), flush=True)
    means = np.mean(rows, axis=0)
    for counts in range(6, 4 + COUNTS * len(COMPARED_PRECISIONS), COUNTS):
        means[counts : counts + 3] = np.sum(rows, axis=0)[counts : counts + 3]
    print(line(["mean", "", "", "", *cells_of(means.tolist())]))


def usual(folder: Path) -> None:
    """Learn the usual probabilities and thresholds again, and print them."""
    parts = []
    for name in TUNED:
        sweeps = read(folder, name)
        mapped = sweeps.part(0, len(sweeps.world_T_sweep) // 2)
        hits = [mapped.points(row) for row in range(len(mapped.world_T_sweep))]
        drawing = Drawing.of(hits, mapped.world_T_sweep)
        parts.append(LevelValidation(most=150).evidence(LevelFixer(), mapped, drawing, OVER_M))
    joined = FixEvidence.joined(parts)
    judge = joined.learned(UNSEEN_SHARE, USUAL)
    print(f"{joined.blocks} validation stretches of {', '.join(TUNED)}")
    print(judge)
    print(joined.thresholds(judge, UNSEEN_SHARE))


def kidnapped(folder: Path, name: str, out: Path) -> str:
    """Draw how the robot of a log is lost and found again; returns what happened, in a line."""
    sweeps = read(folder, name)
    half = len(sweeps.world_T_sweep) // 2
    mapped = sweeps.part(0, half)
    hits = [mapped.points(row) for row in range(half)]
    level_map = Drawing.of(hits, mapped.world_T_sweep).level_map()
    driven = sweeps.part(half, len(sweeps.world_T_sweep))
    middle = len(driven.world_T_sweep) // 2
    rows = [*range(middle), *range(middle + CARRIED, len(driven.world_T_sweep))]
    with TemporaryDirectory() as scratch:
        map_path = Path(scratch, f"{name}.yaml")
        nav2_map.write(map_path, GridMap(level_map.occupancy, level_map.cell_m, level_map.origin))
        pack_map(map_path, map_path.with_suffix(".site"))
        site = Site.open(map_path.with_suffix(".site"))
    assert isinstance(site, LevelSite)
    tracker = Tracker(site)
    drive = []
    for row in rows:
        points_m = np.asarray(driven.points(row), np.float64)
        fix = tracker.localize(points_m, driven.step(row))
        drive.append(level_plan.Seen(points_m, fix, driven.world_T_sweep[row]))
    accepted = np.array([seen.fix.verdict == "accepted" for seen in drive])
    good = OF_SWEEPS.right(
        np.array([seen.fix.world_T_sensor for seen in drive]),
        np.array([seen.world_T_true for seen in drive]),
    )
    found = np.flatnonzero((accepted & good)[middle:])
    title = f"{name}, recorded: carried away after sweep {middle}"
    frames, size_bytes = level_plan.write(level_map, drive, title, out, Progress())
    again = f"found {found[0]} sweeps later" if len(found) else "not found again"
    return (
        f"{out}: {title}, {again}; {accepted.sum()} of {len(drive)} accepted, "
        f"{(accepted & ~good).sum()} of them wrong; {frames} frames, {size_bytes / 1e6:.2f} MB"
    )


def main() -> None:
    parser = argparse.ArgumentParser("python -m benchmarks.level", description=__doc__)
    parser.add_argument("folder", type=Path, help="The folder of the logs, CARMEN above")
    parser.add_argument(
        "--logs", default=",".join(LOGS), help="Logs, separated by commas [%(default)s]"
    )
    parser.add_argument(
        "--shares",
        default=",".join(map(str, SHARES)),
        help="Shares of a log that are mapped, separated by commas [%(default)s]",
    )
    parser.add_argument(
        "--queries", type=int, default=50, help="Sweeps that are localised in each map [50]"
    )
    parser.add_argument(
        "--usual",
        action="store_true",
        help="Learn the usual probabilities and thresholds again instead, and print them",
    )
    parser.add_argument(
        "--kidnapped",
        type=Path,
        metavar="FILE.gif",
        help="Draw a robot that is carried away in the first log instead, into this file",
    )
    options = parser.parse_args()
    logs = options.logs.split(",")
    if options.usual:
        usual(options.folder)
    elif options.kidnapped is not None:
        print(kidnapped(options.folder, logs[0], options.kidnapped))
    else:
        shares = [float(share) for share in options.shares.split(",")]
        table(options.folder, logs, shares, options.queries)


if __name__ == "__main__":
    main()
