"""Poses from level lasers in recorded buildings, and what their verdict is worth.

`python -m benchmarks.level CARMEN [--logs intel,fhw] [--shares .4,.5] [--queries 60]` maps the
first 40 % of the sweeps of each log, and then the first half, by their corrected poses, and
localises sweeps of the rest, evenly chosen, each gathered over the raw odometry before it (ODOM
lines). CARMEN is a folder of NAME-corrected.log.gz. A row a map: how many square metres are free,
how many queries were seen (the map's path within 2 m); right of the seen, of fix and baseline
(the best cell of a single sweep in the same likelihood field, as an exhaustive search finds it:
branch and bound is exact); then for .95 and .99 what share of all queries is accepted, of the seen,
and how many of these are wrong; CPU time of one thread from points to fix.

Verdicts learn from stretches of the mapped part that are held out, never from queries. Where a log
has too few of them, the limits are those of verdict.USUAL, which `--usual` prints anew: learned
from the held-out stretches of the mapped parts of TUNED alone.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

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
from pipeline.level.verdict import LevelEvidence
from pipeline.readers.carmen import Carmen

LOGS = ("intel", "fhw", "seattle", "csail", "aces", "freiburg-101", "freiburg-campus")
TUNED = ("intel", "fhw", "seattle")
"""Whatever was chosen by looking was chosen on these."""
SHARES = (0.4, 0.5)
SEEN_M = 2.0
OVER_M = 5.0


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


def evidence(sweeps: Sweeps, share: float) -> tuple[LevelEvidence, Drawing]:
    """What held-out stretches of the first part of a log say, and its drawing."""
    mapped = sweeps.part(0, int(share * len(sweeps.world_T_sweep)))
    hits = [mapped.points(row) for row in range(len(mapped.world_T_sweep))]
    drawing = Drawing.of(hits, mapped.world_T_sweep)
    return LevelHeldOut().evidence(LevelFixer(), mapped, drawing, OVER_M), drawing


def trial(sweeps: Sweeps, name: str, share: float, queries: int) -> Trial:
    """Map the first part of a log and ask for sweeps of the rest."""
    held_out, drawing = evidence(sweeps, share)
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
