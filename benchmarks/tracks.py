"""Is a tracked robot's pose ever accepted on looser grounds than a single scan's?

`python -m benchmarks.tracks CARMEN [--logs intel,fhw] [--rows drive,carried]` tracks the robots of
recorded level logs, every sweep, by the odometry that was recorded with them (ODOM lines). The map
is drawn from the first half of a log, by its corrected poses; its verdict is tested on stretches of
this half. CARMEN is a folder of NAME-corrected.log.gz, as `yearloc fetch carmen` writes it.

`python -m benchmarks.tracks ARTIFACTS STUDY/GRID/MODEL DAY` follows the queries of a day of 3-D
scans, whose fixes the stage `poses` found one by one, with the filter of the stage `paths`.

Rows:

- drive: the second half, or the day, as it was driven;
- carried: the same in pieces of PIECE scans in random order; the odometry contains no jump;
- standing: a scan is shown STANDING times to a robot that has just been switched on; a sweep has
  new noise each time. STANDS scans take their turns;
- left: the map lacks all within AROUND_M of the middle LEFT_M of the drive (level logs only);
- other: the map is that of the next log (level logs only), so no pose is right;
- off: the queries farther than OFF_M from the training path (days of 3-D scans only).

It prints a row of a table for each: how many poses are accepted at a target precision of .99; how
many of them are wrong, of these `by the log` those whose pose in the log its other sweeps
contradict, which the share leaves out; and the metres of path to the first pose that is accepted
and right (of `carried`, the median over the pieces; of pieces without such a pose it is inf), alone
and tracked.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.level import LOGS, TUNED, is_log_unreliable, line, read
from benchmarks.starts import Day
from pipeline.core import schemas, store
from pipeline.core.frames import travelled_m
from pipeline.level.day import LevelDay
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing, LevelMap
from pipeline.level.sweeps import OVER_M
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.level.verdict import OF_SWEEPS
from pipeline.online.level_pack import CARMEN, LEVEL_VERSIONS, UNSEEN_SHARE
from pipeline.online.level_site import LevelSite
from pipeline.online.site_file import LevelParts
from pipeline.online.site_json import LevelDescription, LevelSettings, Provenance, Sensor
from pipeline.online.tracking import Tracker
from pipeline.paths.filter import Filter
from pipeline.paths.tracks import Track
from pipeline.posing.verdict import OF_SCANS, Verdict

TARGET_PRECISION = 0.99
PIECE = 40
STANDS = 20
STANDING = 10
NOISE_M = 0.01
"""Standard deviation of the noise of a hit's range, and of the odometry of a standing robot."""
LEFT_M = 100.0
AROUND_M = 8.0
OFF_M = 10.0
VALIDATION = 24
"""The most validation stretches of a map."""
LEVEL_ROWS = ("drive", "carried", "standing", "left", "other")
DAY_ROWS = ("drive", "carried", "standing", "off")
HEADER = (
    "log",
    "row",
    "scans",
    "accepted alone",
    "wrong",
    "accepted tracked",
    "wrong",
    "wrong of tracked",
    "m to the first right: alone",
    "tracked",
)


class Answers(NamedTuple):
    """The answers to the scans of some drives."""

    accepted: NDArray[np.bool_]
    right: NDArray[np.bool_]
    by_log: NDArray[np.bool_]
    """Where an accepted pose is wrong, but the log's other sweeps contradict the log's own pose."""


class Shown(NamedTuple):
    """What robots are shown: scans one after the other, in drives of their own."""

    rows: NDArray[np.int64]
    """(scan,) the row of each scan in its log."""
    starts: NDArray[np.bool_]
    """(scan,) True where a robot is switched on: its tracker knows nothing yet."""
    jumps: NDArray[np.bool_]
    """(scan,) True where the robot was carried here, or stands: the odometry contains no step."""


def driven(count: int) -> Shown:
    """A drive of `count` scans as it was."""
    first = np.arange(count) == 0
    return Shown(np.arange(count), first, first)


def carried(count: int) -> Shown:
    """The drive in pieces, in random order."""
    rng = np.random.default_rng(0)
    pieces = [np.arange(first, first + PIECE) for first in range(0, count - PIECE + 1, PIECE)]
    rows = np.concatenate([pieces[number] for number in rng.permutation(len(pieces))])
    scan = np.arange(len(rows))
    return Shown(rows, scan == 0, scan % PIECE == 0)


def standing(count: int) -> Shown:
    """Scans that are shown again and again."""
    rows = np.linspace(0, count - 1, STANDS).round().astype(int).repeat(STANDING)
    scan = np.arange(len(rows))
    return Shown(rows, scan % STANDING == 0, np.ones(len(rows), bool))


SHOWN: dict[str, Callable[[int], Shown]] = {"carried": carried, "standing": standing}


def site_of(level_map: LevelMap, verdict: Verdict, name: str) -> LevelSite:
    """The site of a level map with its verdict."""
    description = LevelDescription(
        name=name,
        simulated=False,
        level=LevelSettings(level_map.cell_m, level_map.origin, OVER_M, LevelFixer()),
        verdict=verdict,
        reader=CARMEN,
        sensor=Sensor(0.0, None, None, None, None, None, ()),
        provenance=Provenance.of(name, {}, LEVEL_VERSIONS),
    )
    return LevelSite(LevelParts(description, {"occupancy": level_map.occupancy}))


def site_of_first_half(sweeps: Sweeps, name: str) -> LevelSite:
    """The site that is packed of the first half of a log."""
    mapped = sweeps.part(0, len(sweeps.world_T_sweep) // 2)
    day = LevelDay.of(mapped, UNSEEN_SHARE, LevelValidation(most=VALIDATION))
    return site_of(day.level_map, day.verdict, name)


def without_middle(sweeps: Sweeps, site: LevelSite) -> LevelSite:
    """The site of a log whose map lacks the surroundings of the middle of the second half."""
    half = len(sweeps.world_T_sweep) // 2
    mapped = sweeps.part(0, half)
    drawing = Drawing.of([mapped.points(row) for row in range(half)], mapped.world_T_sweep)
    way_m = sweeps.world_T_sweep[half:, :2, 3]
    path_m = travelled_m(way_m)
    middle_m = way_m[np.abs(path_m - path_m[-1] / 2) < LEFT_M / 2]
    away_m = np.linalg.norm(mapped.world_T_sweep[:, None, :2, 3] - middle_m, axis=2).min(axis=1)
    level_map = drawing.level_map(away_m < AROUND_M)
    return site_of(level_map, site.description.verdict, site.name)


def sweep_answers(
    site: LevelSite, log: Sweeps, shown: Shown, is_tracking: bool, nowhere: bool
) -> Answers:
    """The answers to the sweeps of a log; `nowhere` says that the map is of another building."""
    rng = np.random.default_rng(0)
    accepted = []
    poses = []
    for row, starts, jumps in zip(shown.rows.tolist(), shown.starts, shown.jumps, strict=True):
        points_m = np.array(log.points(row), np.float64)
        step = log.step(row)
        if starts:
            tracker = Tracker(site, TARGET_PRECISION, is_tracking)
            step = None
        elif jumps:
            range_m = np.linalg.norm(points_m[:, :2], axis=1, keepdims=True)
            points_m[:, :2] *= 1 + rng.normal(0, NOISE_M, range_m.shape) / range_m.clip(NOISE_M)
            step = np.eye(4)
            step[:2, 3] = rng.normal(0, NOISE_M, 2)
        fix = tracker.localize(points_m, step)
        accepted.append(fix.verdict == "accepted")
        poses.append(fix.world_T_sensor)
    right = OF_SWEEPS.right(np.array(poses), log.world_T_sweep[shown.rows])
    right &= not nowhere
    wrong_rows = np.unique(shown.rows[np.array(accepted) & ~right]).tolist()
    by_log = [row for row in wrong_rows if not nowhere and is_log_unreliable(log, row)]
    return Answers(np.array(accepted), right, np.isin(shown.rows, by_log))


def level_rows(folder: Path, logs: Sequence[str], rows: Sequence[str]) -> Iterator[list[str]]:
    """The cells of the rows of level logs."""
    sites = {name: site_of_first_half(read(folder, name), name) for name in logs}
    for number, name in enumerate(logs):
        sweeps = read(folder, name)
        log = sweeps.part(len(sweeps.world_T_sweep) // 2, len(sweeps.world_T_sweep))
        next_name = logs[(number + 1) % len(logs)]
        for row in rows:
            if row == "other" and next_name == name:
                continue
            shown = SHOWN.get(row, driven)(len(log.world_T_sweep))
            site = sites[next_name if row == "other" else name]
            if row == "left":
                site = without_middle(sweeps, site)
            alone, tracked = (
                sweep_answers(site, log, shown, is_tracking, row == "other")
                for is_tracking in (False, True)
            )
            path_m = travelled_m(log.world_T_sweep[:, :2, 3])
            title = f"{name} (tuned on)" if name in TUNED else name
            yield [title, row, *cells(alone, tracked, shown, path_m)]


def day_rows(artifacts: Path, model: str, name: str, rows: Sequence[str]) -> Iterator[list[str]]:
    """The cells of the rows of a day of 3-D scans."""
    day = Day(artifacts, model, name)
    labels = artifacts / "labels" / Path(model).parent / f"{name}.zarr"
    nearest_m = store.read(labels, schemas.Labels).load("nearest_m")
    for row in rows:
        shown = SHOWN.get(row, driven)(len(nearest_m))
        alone = alone_answers(day, shown)
        tracked = filtered_answers(day, shown)
        if row == "off":
            is_off = nearest_m > OFF_M
            shown = Shown(shown.rows[is_off], shown.starts[is_off], shown.jumps[is_off])
            alone = Answers(*(values[is_off] for values in alone))
            tracked = Answers(*(values[is_off] for values in tracked))
        yield [name, row, *cells(alone, tracked, shown, day.passed_m)]


def alone_answers(day: Day, shown: Shown) -> Answers:
    """The fix of each query by itself."""
    right = OF_SCANS.right(day.world_T_query[shown.rows], day.world_T_true[shown.rows])
    return Answers(day.novelty[shown.rows] < day.reject_from, right, np.zeros_like(right))


def filtered_answers(day: Day, shown: Shown) -> Answers:
    """The estimates of the filter along each drive."""
    parts = []
    for drive in np.split(np.arange(len(shown.rows)), np.flatnonzero(shown.starts)[1:]):
        rows = shown.rows[drive]
        odom = [np.eye(4)]
        for before, row, jumps in zip(rows, rows[1:], shown.jumps[drive][1:], strict=False):
            step = np.linalg.inv(day.odom_T_query[before]) @ day.odom_T_query[row]
            odom.append(odom[-1] @ (np.eye(4) if jumps else step))
        track = Track(
            np.array(odom),
            day.world_T_query[rows],
            1 - day.novelty[rows],
            day.novelty[rows] < day.reject_from,
            np.zeros((len(rows), 6, 6)),
            np.where(day.novelty[rows] < day.reject_from, TARGET_PRECISION, 0.0),
        )
        estimates = Filter().along(track)
        right = OF_SCANS.right(estimates.world_T_query, day.world_T_true[rows])
        parts.append(Answers(estimates.accepted(TARGET_PRECISION), right, np.zeros_like(right)))
    return Answers(*map(np.concatenate, zip(*parts, strict=True)))


def cells(alone: Answers, tracked: Answers, shown: Shown, path_m: NDArray[np.float64]) -> list[str]:
    """The cells of a row: counts, and metres to the first right pose."""
    texts = [f"{len(shown.rows):,}"]
    for answers in (alone, tracked):
        wrong = answers.accepted & ~answers.right
        by_log = (wrong & answers.by_log).sum()
        texts += [
            f"{answers.accepted.sum():,}",
            f"{wrong.sum():,}" + (f" ({by_log:,} by the log)" if by_log else ""),
        ]
    share = (wrong & ~tracked.by_log).sum() / max(tracked.accepted.sum(), 1)
    texts.append(f"{share:.1%}")
    return [*texts, *(f"{first_m(answers, shown, path_m):.1f}" for answers in (alone, tracked))]


def first_m(answers: Answers, shown: Shown, path_m: NDArray[np.float64]) -> float:
    """The metres from the start of a piece to the first right pose: the median over the pieces."""
    starts = np.flatnonzero(shown.starts | (np.diff(shown.rows, prepend=-9) != 1))
    found = []
    for piece in np.split(np.arange(len(shown.rows)), starts[1:]):
        hits = piece[(answers.accepted & answers.right)[piece]]
        if len(hits):
            found.append(path_m[shown.rows[hits[0]]] - path_m[shown.rows[piece[0]]])
        else:
            found.append(np.inf)
    return float(np.quantile(found, 0.5, method="higher"))


def main() -> None:
    parser = argparse.ArgumentParser("python -m benchmarks.tracks", description=__doc__)
    parser.add_argument("folder", type=Path, help="The folder of the logs, or of artifacts")
    parser.add_argument("day", nargs="*", help="STUDY/GRID/MODEL and DAY, for artifacts")
    parser.add_argument(
        "--logs", default=",".join(LOGS), help="Logs, separated by commas [%(default)s]"
    )
    parser.add_argument("--rows", help="Rows, separated by commas [all]")
    options = parser.parse_args()
    print(line(HEADER))
    print(line(["---"] * len(HEADER)), flush=True)
    chosen = options.rows.split(",") if options.rows else None
    if options.day:
        model, name = options.day
        rows = day_rows(options.folder, model, name, chosen or DAY_ROWS)
    else:
        rows = level_rows(options.folder, options.logs.split(","), chosen or LEVEL_ROWS)
    for texts in rows:
        print(line(texts), flush=True)


if __name__ == "__main__":
    main()
