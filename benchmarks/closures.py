"""Poses and verdicts of one test day by peers: `python -m benchmarks.closures ARTIFACTS
STUDY/GRID/MODEL DAY [EVERY [PEERS]]`.

It reads artifacts that `dvc repro` built of a study with poses, and takes every EVERY-th query.
PEERS is a folder of programs built by benchmarks/PEERS.md. A line says which peers are left out
because they are not there. Each decides by a threshold of its own:

- yearloc by the threshold of its target precision .99; its poses and verdicts are those of the
  artifact, and the time is that of a fix
- MapClosures by its inliers, with local maps of the path driven last, and with local maps as its
  authors cut them
- GICP by whether it converged, from Scan Context's first candidates and headings
- KISS-Matcher by its inliers with the map's tiles, submaps at least TILE_M apart

Further rows decide nothing, and start from the ranking's first CANDIDATES: yearloc without going on
to other candidates and to the whole map, ICP and GICP from the matches of walls there.

Time is CPU time a query, on one thread, without the time to load or build points, local maps,
rankings and the map's clouds.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import small_gicp
from hydra.utils import instantiate
from numpy.typing import NDArray
from omegaconf import OmegaConf

from pipeline.core import schemas, store
from pipeline.core.frames import Poses, turns, wrapped_deg, yaw
from pipeline.mapping.gathering import submap_points
from pipeline.posing.registration import Points
from pipeline.posing.search import Answers as Ranked
from pipeline.posing.search import Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import OF_SCANS

SEEN_M = 5.0
TILE_M = 20.0
CANDIDATES = 5
VOXEL_M = 0.5
REACHES_M = (4.0, 1.0)
"""Largest distance of pairs in ICP and GICP: at first, and then."""
LOCAL_M = (100.0, 60.0)
"""The reaches of MapClosures' local maps: its program's default, and one for drives of 1 km."""
ICP = {"ICP, point to point": "ICP", "ICP, point to plane": "PLANE_ICP", "GICP": "GICP"}
LEAST_INLIERS = 5
"""With at least so many inliers KISS-Matcher's examples call a registration a success."""
One = Callable[[int, Points], tuple[NDArray[np.float64], bool]]
"""A query's row and points (n, 3) → world_T_query (4, 4) and whether it is accepted."""
Guesses = Callable[[int, Points], Iterable[tuple[int, NDArray[np.float64]]]]
"""A query's row and points (n, 3) → rows of training submaps, each with submap_T_query (4, 4)."""


@dataclass(frozen=True)
class Answers:
    """The answers of one peer to the queries."""

    world_T_query: Poses
    """(q, 4, 4); NaN without one."""
    world_T_true: Poses
    accepted: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    """(q,) whether training passed nearby."""
    took_ms: NDArray[np.float64]

    def line(self, name: str) -> str:
        """A row of the table."""
        good = OF_SCANS.right(self.world_T_query, self.world_T_true)
        level = self.right_from_above()
        found, kept = (
            each[self.seen].mean() if self.seen.any() else np.nan
            for each in (good, good & self.accepted)
        )
        wrong = (self.accepted & ~good).sum()
        wrong_from_above = (self.accepted & ~level).sum()
        medians = (
            f"{np.median(took_ms):7.0f}" if len(took_ms) else f"{'–':>7}"
            for took_ms in (self.took_ms[self.seen], self.took_ms)
        )
        counts = f"{self.accepted.sum():9} {wrong:6} {wrong_from_above:6}"
        return (
            f"  {name:<40} {len(good):5} {self.seen.sum():5} {found:6.3f} {kept:6.3f} {counts} "
            f"{' '.join(medians)}"
        )

    def right_from_above(self) -> NDArray[np.bool_]:
        """Which poses are right if height, roll and pitch are ignored."""
        off_m = np.linalg.norm(self.world_T_query[:, :2, 3] - self.world_T_true[:, :2, 3], axis=1)
        turn_deg = np.abs(wrapped_deg(np.rad2deg(yaw(self.world_T_query) - yaw(self.world_T_true))))
        right_m, right_deg = OF_SCANS.right_within
        return np.asarray((off_m < right_m) & (turn_deg < right_deg))


class Day:
    """The artifacts of one day, and the rows of the queries."""

    def __init__(self, artifacts: Path, model: str, sequence: str, every: int) -> None:
        study = model.split("/")[0]
        name = f"{sequence}.zarr"
        (self.map_path,) = (artifacts / "map" / study).glob("*.zarr")
        self.targets = Targets.read(self.map_path)
        self.scans, self.trained = (
            store.read(artifacts / "scans" / study / each, schemas.Scans)
            for each in (name, self.map_path.name)
        )
        self.submaps = store.read(artifacts / "submaps" / study / name, schemas.Submaps)
        self.fixes = store.read(artifacts / "poses" / model / name, schemas.Fixes)
        self.rankings = store.read(artifacts / "localize" / model / name, schemas.Rankings)
        self.scan_context = artifacts / "localize" / Path(model).parent / "scan_context" / name
        self.rows = np.arange(0, len(self.submaps.load("scans")), every)
        self.world_T_true = self.submaps.load("world_T_anchor")[self.rows]

    def clouds(self) -> Iterator[tuple[int, Points]]:
        """Each query's row and points (n, 3)."""
        for row in self.rows.tolist():
            yield row, next(iter(submap_points(self.scans, self.submaps, slice(row, row + 1))))

    def near(self, world_T_a: Poses) -> NDArray[np.bool_]:
        """Which of these poses (n, 4, 4) training passed nearby."""
        anchors_m = self.targets.world_T_anchor[:, :2, 3]
        return np.asarray(
            np.linalg.norm(world_T_a[:, None, :2, 3] - anchors_m, axis=2).min(axis=1) < SEEN_M
        )

    def asked(self, one: One, prepares: bool) -> Answers:
        """The answers of a peer.

        A peer that `prepares` the map's clouds at their first use is called twice for each query.
        """
        found = []
        accepted = []
        took_ms = []
        for row, points_m in self.clouds():
            if prepares:
                one(row, points_m)
            start = time.process_time()
            world_T_query, kept = one(row, points_m)
            took_ms.append(1e3 * (time.process_time() - start))
            found.append(world_T_query)
            accepted.append(kept)
        return Answers(
            np.array(found),
            self.world_T_true,
            np.array(accepted),
            self.near(self.world_T_true),
            np.array(took_ms),
        )


def yearloc(day: Day, fixer: Fixer) -> Answers:
    """Poses and verdicts of the artifact; the time is of the same fixes, computed again."""
    novelty = day.fixes.load("novelty")[:, 0]
    made = from_ranking(day, fixer)
    accepted = novelty[day.rows] < day.fixes.reject_from()
    world_T_query = day.fixes.load("world_T_query")[day.rows]
    return replace(made, world_T_query=world_T_query, accepted=accepted)


def from_ranking(day: Day, fixer: Fixer) -> Answers:
    """Fixes from the ranking's answers, all taken without a verdict."""
    xy_m = day.rankings.load("xy_m")

    def one(query: int, points_m: Points) -> tuple[NDArray[np.float64], bool]:
        ranked = Ranked(xy_m[query], np.full(len(xy_m[query]), np.nan))
        return fixer.fix(points_m, day.targets, ranked).pose, False

    return day.asked(one, True)


def of_walls(day: Day, fixer: Fixer) -> Guesses:
    """The ranking's first candidates, each with the match of the walls there."""
    xy_m = day.rankings.load("xy_m")
    targets = day.targets

    def guesses(query: int, points_m: Points) -> Iterator[tuple[int, NDArray[np.float64]]]:
        walls = fixer.walls.cells_at_headings(fixer.walls.of(points_m))
        is_taken = np.zeros(len(targets.world_T_anchor), bool)
        for row in islice(targets.spaced(targets.nearest(xy_m[query], is_taken)), CANDIDATES):
            yield row, fixer.walls.match(targets.chart(fixer.walls, row), walls).target_T_query

    return guesses


def of_scan_context(day: Day) -> Guesses:
    """Scan Context's first candidates, each at its own place with the heading found there."""
    rankings = store.read(day.scan_context, schemas.Rankings)
    xy_m = rankings.load("xy_m")[:, :CANDIDATES]
    heading_deg = rankings.load("heading_deg")[:, :CANDIDATES]
    world_T_anchor = day.targets.world_T_anchor

    def guesses(query: int, points_m: Points) -> Iterator[tuple[int, NDArray[np.float64]]]:
        away_m = np.linalg.norm(world_T_anchor[:, :2, 3] - xy_m[query][:, None], axis=2)
        rows = away_m.argmin(axis=1)
        return zip(
            rows.tolist(),
            turns(np.deg2rad(heading_deg[query]) - yaw(world_T_anchor[rows])),
            strict=True,
        )

    return guesses


def registered(day: Day, kind: str, guesses: Guesses, decides: bool) -> Answers:
    """The guess with the most inliers, registered by small_gicp.

    If it `decides`, it accepts where the registration converged.
    """
    prepared = lru_cache(128)(
        lambda row: small_gicp.preprocess_points(day.targets.points_m(row), VOXEL_M, 10)
    )

    def one(query: int, points_m: Points) -> tuple[NDArray[np.float64], bool]:
        best = np.full((4, 4), np.nan)
        converged = False
        most = -1
        source = small_gicp.preprocess_points(points_m, VOXEL_M, 10)[0]
        for row, submap_T_query in guesses(query, points_m):
            cloud, tree = prepared(row)
            for reach_m in REACHES_M:
                result = small_gicp.align(
                    cloud,
                    source,
                    tree,
                    submap_T_query,
                    registration_type=kind,
                    max_correspondence_distance=reach_m,
                )
                submap_T_query = result.T_target_source
            if result.num_inliers > most:
                best = day.targets.world_T_anchor[row] @ submap_T_query
                converged = result.converged
                most = result.num_inliers
        return best, converged and decides

    return day.asked(one, True)


def kiss(day: Day) -> Answers:
    """KISS-Matcher at 1 m voxels with every tile of the map; the one with most inliers counts."""
    import kiss_matcher

    anchors_m = day.targets.world_T_anchor[:, :2, 3]
    tiles: list[int] = []
    for row, anchor_m in enumerate(anchors_m):
        if (np.linalg.norm(anchors_m[tiles] - anchor_m, axis=1) >= TILE_M).all():
            tiles.append(row)
    clouds = [(row, list(day.targets.points_m(row).astype(np.float32))) for row in tiles]

    def one(query: int, points_m: Points) -> tuple[NDArray[np.float64], bool]:
        best = np.full((4, 4), np.nan)
        most = -1
        source = list(points_m.astype(np.float32))
        for row, target in clouds:
            matcher = kiss_matcher.KISSMatcher(1.0)
            submap_T_query = np.eye(4)
            result = matcher.estimate(source, target)
            submap_T_query[:3, :3] = result.rotation
            submap_T_query[:3, 3] = np.ravel(result.translation)
            if matcher.get_num_final_inliers() > most:
                best = day.targets.world_T_anchor[row] @ submap_T_query
                most = matcher.get_num_final_inliers()
        return best, most >= LEAST_INLIERS

    return day.asked(one, False)


def map_closures(day: Day, program: Path, reach_m: float) -> Iterator[tuple[str, Answers]]:
    """MapClosures on our queries, and on local maps as its authors cut them, like its database."""
    with TemporaryDirectory() as scratch:
        train, test, out = (Path(scratch, f"{each}.npz") for each in ("train", "test", "out"))
        layout = day.submaps.layout
        last = day.submaps.load("scans")[day.rows]
        for path, scans in ((train, day.trained), (test, day.scans)):
            points_m = scans.load("points").astype(np.float32) * np.float32(scans.attrs["grain_m"])
            np.savez(
                path,
                points=points_m,
                offsets=scans.load("offsets"),
                placed_T_scan=scans.load(layout),
                asked=last,
            )
        subprocess.run([program, train, test, str(reach_m), out], check=True)
        with np.load(out) as found:
            answers = dict(found)
    world_T_trained = day.trained.load("world_T_scan")
    world_T_scan = day.scans.load("world_T_scan")
    near = day.near(world_T_scan)
    for kind, name in (("asked", "queries"), ("own", "its own local maps")):
        frame, first, stop, reference, accepted, inliers, took_ms, reference_T_frame = (
            answers[f"{kind}_{each}"]
            for each in (
                "frame",
                "first",
                "stop",
                "reference",
                "accepted",
                "inliers",
                "took_ms",
                "reference_T_frame",
            )
        )
        seen = (
            near[frame]
            if kind == "asked"
            else np.array([near[a:b].mean() > 0.5 for a, b in zip(first, stop, strict=True)])
        )
        world_T_query = np.where(
            inliers[:, None, None] > 0, world_T_trained[reference] @ reference_T_frame, np.nan
        )
        yield (
            f"MapClosures, {reach_m:.0f} m, {name}",
            Answers(world_T_query, world_T_scan[frame], accepted, seen, took_ms),
        )


def table(day: Day, programs: Path) -> Iterator[str]:
    """A row a peer that is there, a line a peer that is not."""
    yield f"  {'':<40} {'':12} {'of the seen':>12}  {'':16} {'from':>6} {'ms of the':>11}"
    yield f"  {'':<40} asked  seen  right   kept  accepted  wrong  above    seen     all"
    fixer: Fixer = instantiate(OmegaConf.load("conf/poses.yaml").fixer)
    yield yearloc(day, fixer).line("yearloc")
    program = programs / "map_closures"
    if program.is_file():
        for reach_m in LOCAL_M:
            yield from (answers.line(name) for name, answers in map_closures(day, program, reach_m))
    else:
        yield f"  MapClosures left out: {program} is not there (benchmarks/PEERS.md)"
    if day.scan_context.is_dir():
        guesses = of_scan_context(day)
        yield registered(day, "GICP", guesses, True).line("GICP from Scan Context")
    else:
        yield (
            f"  GICP left out: {day.scan_context} is not there (yearloc use … "
            "methods=…,scan_context)"
        )
    try:
        yield kiss(day).line(f"KISS-Matcher, tiles {TILE_M:.0f} m apart")
    except ImportError:
        yield "  KISS-Matcher left out: kiss_matcher is not installed (pip install .[kiss])"
    one_round = replace(fixer, rounds=(CANDIDATES,))
    yield from_ranking(day, one_round).line("yearloc, from the first candidates")
    for name, kind in ICP.items():
        yield registered(day, kind, of_walls(day, fixer), False).line(name)


def main(
    artifacts: str, model: str, sequence: str, every: str = "3", programs: str = "peers"
) -> None:
    """Print the table.

    Of the seen queries it has the share within 2 m and 5°, and the share that is accepted too; of
    all queries how many are accepted, and how many of these are wrong, in space and from above; and
    medians of times.
    """
    print(f"{model} {sequence}")
    for line in table(Day(Path(artifacts), model, sequence, int(every)), Path(programs)):
        print(line, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
