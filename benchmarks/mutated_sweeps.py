"""Whether a level site accepts a wrong pose of sweeps that are broken, or of another building.

`python -m benchmarks.mutated_sweeps CARMEN [--count 2000] [--logs fhw,csail]` maps the first half
of each of five recorded buildings, as for the site of a Nav2 map, and localises sweeps of the other
half, drawn at random and mutated in one of KINDS. Every other sweep is gathered over its odometry;
the others stand alone. CARMEN is as in benchmarks.level. Each row is a kind: how many sweeps were
queried; how many were accepted at the target precision .99; how many of these are wrong, more than
1 m or 10° off; and how many of the wrong ones have a log whose other sweeps contradict its own
pose. A laser that is turned about its own axis has to find the pose of its own frame. Of another
building's sweeps each accepted pose is wrong. The last row is of sweeps as they were recorded.

How such sweeps are recognised was tuned on Intel, which is left out.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.level import is_log_unreliable, line, read
from pipeline.level.day import LevelDay
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.sweeps import OVER_M
from pipeline.level.validation import Sweeps
from pipeline.level.verdict import NO_EVIDENCE, OF_SWEEPS, verdict_of
from pipeline.online.level_pack import UNSEEN_SHARE
from pipeline.posing.learned_verdict import Learned
from pipeline.posing.verdict import TARGET_PRECISIONS

BUILDINGS = ("fhw", "seattle", "csail", "aces", "freiburg-101")
TARGET_PRECISION = 0.99
BEFORE = 15
"""Sweeps before a query at most, from which it is gathered."""
RANGE_MAX_M = 29.9

Points = NDArray[np.float64]
Mutation = Callable[[Points, np.random.Generator], Points]


def without_beams(points_m: Points, rng: np.random.Generator) -> Points:
    """Some 30 to 95 % of the beams are dropped."""
    is_kept = rng.random(len(points_m)) > rng.uniform(0.3, 0.95)
    return np.asarray(points_m[is_kept])


def twelve_beams(points_m: Points, rng: np.random.Generator) -> Points:
    rows = rng.choice(len(points_m), min(12, len(points_m)), replace=False)
    return np.asarray(points_m[rows])


def hits_at_range_max(points_m: Points, rng: np.random.Generator) -> Points:
    """Some 30 to 90 % of the beams say range_max, as if they had hit something there."""
    far_m = points_m / np.maximum(np.linalg.norm(points_m, axis=1), 1e-6)[:, None] * RANGE_MAX_M
    return np.where((rng.random(len(points_m)) < rng.uniform(0.3, 0.9))[:, None], far_m, points_m)


def turned(points_m: Points, rng: np.random.Generator) -> Points:
    """The laser is mounted a quarter turn to the left."""
    return np.asarray(points_m @ TURNED[:2, :2])


def upside_down(points_m: Points, rng: np.random.Generator) -> Points:
    return points_m * (1.0, -1.0)


def noisy(points_m: Points, rng: np.random.Generator) -> Points:
    """Ranges are off by a standard deviation of .3 to 2 m."""
    ranges_m = np.maximum(np.linalg.norm(points_m, axis=1), 1e-6)
    off_m = rng.normal(0, rng.uniform(0.3, 2.0), len(points_m))
    return np.asarray(points_m * (1 + off_m / ranges_m)[:, None])


def not_numbers(points_m: Points, rng: np.random.Generator) -> Points:
    """Some 50 to 100 % of the beams are NaN."""
    points_m = points_m.copy()
    points_m[rng.random(len(points_m)) < rng.uniform(0.5, 1.0)] = np.nan
    return points_m


def scaled(points_m: Points, rng: np.random.Generator) -> Points:
    """Not in metres."""
    return points_m * float(rng.choice([0.3048, 0.7, 1.4, 3.28]))


def anything(points_m: Points, rng: np.random.Generator) -> Points:
    """Points that no building made."""
    return rng.uniform(-10, 10, points_m.shape)


TURNED = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""robot_T_laser (4, 4) of a laser that is turned."""
AS_RECORDED = "as recorded"
OTHER = "of another building"
KINDS: dict[str, Mutation] = {
    "turned by 90°": turned,
    "upside down": upside_down,
    "beams dropped": without_beams,
    "twelve beams": twelve_beams,
    "hits at range_max": hits_at_range_max,
    "noise": noisy,
    "NaN": not_numbers,
    "not in metres": scaled,
    "random points": anything,
    OTHER: lambda points_m, rng: points_m,
    AS_RECORDED: lambda points_m, rng: points_m,
}


def building(sweeps: Sweeps) -> tuple[LevelDay, Sweeps]:
    """The map of the first half of a log with the usual verdict, and the other half."""
    half = len(sweeps.world_T_sweep) // 2
    mapped = sweeps.part(0, half)
    drawing = Drawing.of([mapped.points(row) for row in range(half)], mapped.world_T_sweep)
    verdict = verdict_of(NO_EVIDENCE, UNSEEN_SHARE)
    asked = sweeps.part(half, len(sweeps.world_T_sweep))
    return LevelDay(drawing.level_map(), Learned(verdict, 0), LevelFixer()), asked


def mutated(
    sweeps: Sweeps, row: int, before: int, mutation: Mutation, rng: np.random.Generator
) -> Sweeps:
    """A sweep and those before it, each mutated."""
    first = max(0, row - before)
    part = sweeps.part(first, row + 1)
    count = len(part.world_T_sweep)
    points = [
        mutation(np.asarray(part.points(number), np.float64)[:, :2], rng) for number in range(count)
    ]
    return Sweeps(points.__getitem__, part.world_T_sweep, part.odom_T_sweep)


@dataclass
class Counts:
    """The results of the sweeps of one kind."""

    asked: int = 0
    accepted: int = 0
    wrong: int = 0
    unreliable: int = 0
    """Wrong poses for which the log's other sweeps contradict its own pose."""

    @property
    def cells(self) -> list[str]:
        return [str(count) for count in (self.asked, self.accepted, self.wrong, self.unreliable)]


def counted(
    kind: str, count: int, logs: Sequence[Sweeps], buildings: Sequence[tuple[LevelDay, Sweeps]]
) -> Counts:
    """Localise `count` sweeps of one kind, drawn at random for this kind alone."""
    rng = np.random.default_rng(list(KINDS).index(kind))
    counts = Counts()
    for number in range(count):
        here = int(rng.integers(len(buildings)))
        day, sweeps = buildings[here]
        if kind == OTHER:
            sweeps = buildings[(here + int(rng.integers(1, len(buildings)))) % len(buildings)][1]
        row = int(rng.integers(len(sweeps.world_T_sweep)))
        before = BEFORE if number % 2 else 0
        part = mutated(sweeps, row, before, KINDS[kind], rng)
        last = len(part.world_T_sweep) - 1
        query = day.query(part.gathered([last], OVER_M)[last])
        counts.asked += 1
        threshold = dict(zip(TARGET_PRECISIONS, day.verdict.claim_thresholds["fix"], strict=True))[
            TARGET_PRECISION
        ]
        if not np.float32(query.error_probabilities[0]) < threshold:
            continue
        counts.accepted += 1
        true = part.world_T_sweep[last]
        if KINDS[kind] is turned:
            true = true @ TURNED
        if kind == OTHER:
            counts.wrong += 1
        elif not OF_SWEEPS.right(query.pose[None], true[None])[0]:
            counts.wrong += 1
            first = len(logs[here].world_T_sweep) - len(sweeps.world_T_sweep)
            counts.unreliable += is_log_unreliable(logs[here], first + row)
    return counts


def main() -> None:
    parser = argparse.ArgumentParser("python -m benchmarks.mutated_sweeps", description=__doc__)
    parser.add_argument("folder", type=Path, help="The folder of the logs, CARMEN above")
    parser.add_argument(
        "--count", type=int, default=2000, help="Sweeps of all mutated kinds together [2000]"
    )
    parser.add_argument(
        "--logs", default=",".join(BUILDINGS), help="Logs, separated by commas [%(default)s]"
    )
    options = parser.parse_args()
    logs = [read(options.folder, name) for name in options.logs.split(",")]
    buildings = [building(log) for log in logs]
    kinds = [kind for kind in KINDS if kind != OTHER or len(buildings) > 1]
    print(line(["sweeps", "queried", "accepted", "wrong", "of these, by the log"]))
    print(line(["---"] * 5), flush=True)
    for kind in kinds:
        counts = counted(kind, options.count // (len(KINDS) - 1), logs, buildings)
        print(line([kind, *counts.cells]), flush=True)


if __name__ == "__main__":
    main()
