"""How soon a robot that starts anywhere on a day knows where it is, by single poses and filtered.

`python -m benchmarks.starts ARTIFACTS STUDY/GRID/MODEL DAY`: there are 500 random starts. The
odometry has an added drift of 1 % and .1° a metre, or 5 % and .5° a metre. After 60 queries the
robot is carried elsewhere. If the study has a model `sad`, SeqSLAM's answers stand beside: right
within 15 m, without a pose, known five queries later. Where training never was, every accepted
answer is wrong.
"""

import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core import schemas, store
from pipeline.core.frames import travelled_m
from pipeline.paths.filter import Filter
from pipeline.paths.tracks import Track
from pipeline.posing.verdict import OF_SCANS

TURN_DEG_PER_M = 10.0
"""A drift of 1 % turns the odometry by a hundredth of this each metre, always to the same side."""
STARTS = 500
LONGEST = 60
CARRIED_M = 50.0
BETWEEN = 5
CORRECT_M = 15.0
TARGET_PRECISION = 0.99
Answers = tuple[NDArray[np.bool_], NDArray[np.bool_]]
"""Which queries are accepted, and which of all are right."""
Way = Callable[["Day", NDArray[np.int64], np.random.Generator], Answers]


class Day:
    """The artifacts of one day."""

    def __init__(self, artifacts: Path, model: str, sequence: str) -> None:
        study = model.split("/")[0]
        name = f"{sequence}.zarr"
        self.fixes = store.read(artifacts / "poses" / model / name, schemas.Fixes)
        submaps = store.read(artifacts / "submaps" / study / name, schemas.Submaps)
        self.world_T_true = submaps.load("world_T_anchor")
        self.stamps_ns = submaps.load("stamps_ns")
        scans = store.read(artifacts / "scans" / study / name, schemas.Scans)
        self.odom_T_query = scans.load("odom_T_scan")[submaps.load("scans")]
        n = len(self.stamps_ns)
        self.world_T_query = self.fixes.load("world_T_query")[:n]
        self.novelty = self.fixes.load("novelty")[:n, 0].astype(np.float64)
        self.reject_from = self.fixes.reject_from(TARGET_PRECISION)
        sad = artifacts / "localize" / Path(model).parent / "sad" / name
        self.sad = store.read(sad, schemas.Rankings) if sad.is_dir() else None
        self.passed_m = travelled_m(self.world_T_true[:, :2, 3])


def alone(day: Day, rows: NDArray[np.int64], rng: np.random.Generator) -> Answers:
    """Each query by itself."""
    return day.novelty[rows] < day.reject_from, OF_SCANS.right(
        day.world_T_query[rows], day.world_T_true[rows]
    )


def filtered(day: Day, rows: NDArray[np.int64], rng: np.random.Generator, drift: float) -> Answers:
    """The filter's answers; the odometry does not contain the carrying."""
    odom = [np.eye(4)]
    scale = 1 + drift * rng.choice([-1, 1])
    sign = rng.choice([-1, 1])
    for before, row in pairwise(rows.tolist()):
        step = np.eye(4)
        if row == before + 1:
            step = np.linalg.inv(day.odom_T_query[before]) @ day.odom_T_query[row]
            turn_deg = TURN_DEG_PER_M * drift * sign * np.linalg.norm(step[:3, 3])
            step[:3, 3] *= scale
            step[:3, :3] @= Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
        odom.append(odom[-1] @ step)
    none = np.zeros((len(rows), 6, 6))
    track = Track(
        np.array(odom),
        day.world_T_query[rows],
        1 - day.novelty[rows],
        np.zeros(len(rows), bool),
        none,
        np.where(day.novelty[rows] < day.reject_from, TARGET_PRECISION, 0.0),
    )
    estimates = Filter().along(track)
    return estimates.accepted(TARGET_PRECISION), OF_SCANS.right(
        estimates.world_T_query, day.world_T_true[rows]
    )


def sequences(day: Day, rows: NDArray[np.int64], rng: np.random.Generator) -> Answers:
    """SeqSLAM's answers, of the queries that have five others of the same drive on each side."""
    assert day.sad is not None
    off_m = np.linalg.norm(day.sad.load("xy_m")[rows, 0] - day.world_T_true[rows, :2, 3], axis=1)
    accepted = day.sad.load("novelty")[rows, 0] < day.sad.thresholds[0]
    inside = (rows - BETWEEN == np.roll(rows, BETWEEN)) & (
        rows + BETWEEN == np.roll(rows, -BETWEEN)
    )
    late = np.roll(inside, BETWEEN)
    return np.roll(accepted & inside, BETWEEN) & late, np.roll(off_m < CORRECT_M, BETWEEN)


def line(day: Day, way: Way) -> str:
    """The results of all starts, as a row of a table."""
    rng = np.random.default_rng(0)
    accepted = np.zeros(2, int)
    wrong = np.zeros(2, int)
    first = list[tuple[float, float]]()
    again = list[tuple[float, float]]()
    for start in rng.integers(0, len(day.stamps_ns) - LONGEST, STARTS).tolist():
        off_m = np.linalg.norm(
            day.world_T_true[:-LONGEST, :2, 3] - day.world_T_true[start, :2, 3], axis=1
        )
        carried = int(rng.choice(np.flatnonzero(off_m > CARRIED_M)))
        rows = np.concatenate([start + np.arange(LONGEST), carried + np.arange(LONGEST)])
        kept, good = way(day, rows, rng)
        accepted += kept.reshape(2, -1).sum(axis=1)
        wrong += (kept & ~good).reshape(2, -1).sum(axis=1)
        for part, found in ((slice(0, LONGEST), first), (slice(LONGEST, None), again)):
            hits = np.flatnonzero((kept & good)[part])
            row = rows[part][hits[0]] if len(hits) else None
            origin = rows[part][0]
            found.append(
                (np.inf, np.inf)
                if row is None
                else (
                    day.passed_m[row] - day.passed_m[origin],
                    (day.stamps_ns[row] - day.stamps_ns[origin]) / 1e9,
                )
            )
    cells = []
    for found in (first, again):
        metres, seconds = np.array(found).T
        cells.append(
            f"{np.median(metres):5.1f} m {np.median(seconds):5.1f} s, 90 % "
            f"{np.quantile(metres, 0.9, method='higher'):6.1f} m"
        )
    never = np.isinf(np.array(first)[:, 0]).mean()
    before, after = (
        f"{bad} of {all_} ({bad / max(all_, 1):.2%})"
        for bad, all_ in zip(wrong, accepted, strict=True)
    )
    return (
        f"start {cells[0]} | carried {cells[1]} | never {never:6.1%} | wrong {before}, carried "
        f"{after}"
    )


def main(artifacts: str, model: str, sequence: str) -> None:
    day = Day(Path(artifacts), model, sequence)
    ways: dict[str, Way] = {
        "each alone": alone,
        "filter, drift 1 %": partial(filtered, drift=0.01),
        "filter, drift 5 %": partial(filtered, drift=0.05),
    }
    if day.sad is not None:
        ways["SeqSLAM (15 m)"] = sequences
    for name, way in ways.items():
        print(f"{name:<18} {line(day, way)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
