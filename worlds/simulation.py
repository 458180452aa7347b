"""The simulated world: a yaml of conf/world in, the raw logs of its sequences out.

A world is a place, a year in which it changes, and a robot that drives through it on some days.
Logs are written in a real data set's format, with the ground truth beside them. To record a
sequence:

1. Plan the streets and the route.
2. Build the campus, and simulate the events of its year.
3. Drive along the route on the day of the sequence.
4. Take the scans from the robot in the scene of that day, and write them.
"""

import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, Share, checked
from pipeline.formats.changes import Change
from worlds.driving.day import TWIGS_PER_M, simulate_day
from worlds.driving.drive import drive, reference_poses
from worlds.driving.entry import Entry
from worlds.driving.recorder import Recorder, Recording
from worlds.driving.robots import ROBOTS, Robot
from worlds.layout.blocks import build_campus
from worlds.layout.campus import Campus
from worlds.layout.events import Event, simulate_year, visible_changes
from worlds.layout.lining import Lining
from worlds.layout.plan import Plan
from worlds.layout.routes import Routes, loop_routes, training_routes
from worlds.names import kitti_log
from worlds.seeds import Stream, generator
from worlds.writers import BAGS, Format, origin_m, writer
from worlds.writers.writer import GroundTruthWriter

BLOCK_RAYS = 400_000
"""Approximate number of rays in a block of scans, which one worker casts at once."""
LOG_SEEDS = 7919
"""Step between the seeds of a scanner car's logs, each of which has a world of its own."""
MAX_SEED = (1 << 20) - 1
TRAINING_ENTRY = {"unseen": 0.0, "reversed": 0.0}
"""The entry that the training sequence must have."""


@dataclass(frozen=True)
@checked("world")
class Simulation:
    """A world and its sequences; its fields are the keys of the yamls in conf/world."""

    seed: int
    blocks: Count
    """There are blocks × blocks blocks between the streets, each about 95 m wide."""
    route_m: Positive
    """Length of each sequence; with a `route_file` at most the length of its route."""
    step_m: Positive
    """Path between scans, or sweeps."""
    azimuths: Count
    """Rays per turn of each beam of the scanner; for a push-broom, rays per sweep."""
    sequences: Mapping[str, Mapping[str, float]]
    """The name of each sequence, with the settings of its `Entry`.

    The first is the training sequence. Its shares are 0, and it does not depend on the others.
    """
    events_per_km_of_route: NotNegative = 3.0
    """Number of buildings built or demolished in fifteen months; 14 is very many."""
    near_route: Share = 0.6
    """Share of these events that are near the training route."""
    route_file: str | None = None
    """A trajectory file with columns x, y or TUM rows, along which the training sequence drives."""
    robot: Literal["segway", "segway_inverted", "push_broom_car", "scanner_car"] = "segway"
    logs: Format = "nclt"
    """The format of the logs."""
    relief_m: NotNegative = 0.0
    """How far parts of a wall lie before or behind its plane, at most."""
    twigs_per_m: NotNegative = TWIGS_PER_M
    """Extinction of bare deciduous trees, per metre."""
    lining: Lining = "sparse"
    """What stands close along the streets. A `street` is narrow and has houses, gardens and cars on
    both sides; a `campus` has hedges, low walls and bushes beside its ways; `sparse` has
    nothing. `terraces` have equal terraced houses on both sides of every street, a `colonnade` has
    equal halls with equal pillars: worlds that repeat, on flat ground."""
    turn_s: NotNegative = 0.0
    """How long the scanner takes for a turn, during which the robot drives on; bags say when each
    point was measured. With 0 a scan is taken at one moment."""
    ground_truth_sd_m: NotNegative = 0.0
    """Standard deviation of the written ground truth, which wanders about the driven path like a
    SLAM solution; with 0 it is exact."""

    def __post_init__(self) -> None:
        if self.logs not in self._robot.logs:
            raise ConfigError(
                f"world.logs={self.logs}: the robot {self.robot} writes "
                f"{' or '.join(self._robot.logs)}"
            )
        if self.turn_s and self.logs not in BAGS:
            raise ConfigError(
                f"world.turn_s={self.turn_s}: logs={self.logs} have no times of points; expected "
                f"{', '.join(BAGS)}, or 0"
            )
        if self.route_file is not None and self._robot.loops:
            raise ConfigError(
                f"world.route_file={self.route_file}: the robot {self.robot} plans loops of its "
                "own; leave it null"
            )
        if not 0 <= self.seed <= MAX_SEED:
            raise ConfigError(f"world.seed={self.seed}: must lie in 0 to {MAX_SEED}")
        if self.blocks < 2 or self.route_m < self.step_m:
            raise ConfigError(
                f"world.blocks={self.blocks}, route_m={self.route_m}: needs 2 blocks and a route "
                "of one step_m"
            )
        if not self.sequences:
            raise ConfigError("world.sequences: needs at least the training sequence")
        for sequence, settings in self.sequences.items():
            self._robot.departs(sequence)
            Entry.of(sequence, settings)
        if dict(self.sequences[self.training]) != TRAINING_ENTRY and not self._robot.loops:
            raise ConfigError(
                f"world.sequences.{self.training}: the first is the training sequence, unseen and "
                "reversed are 0"
            )

    @property
    def training(self) -> str:
        """The name of the training sequence."""
        return next(iter(self.sequences))

    @property
    def _robot(self) -> Robot:
        """The robot by its name."""
        return ROBOTS[self.robot]

    def record(
        self,
        sequence: str,
        folder: Path,
        compute: Compute,
        watch: Progress,
        ground_truth: Path | None = None,
    ) -> Recording:
        """Drive `sequence` and write its logs into `folder`.

        Labels that no robot could record go into the folder `ground_truth`/sequence, if wanted. The
        bytes depend only on the parameters of the world, the training entry, and the name and entry
        of the sequence. Raises ConfigError for a sequence without an entry, or a route file that
        cannot be driven.
        """
        # 1. Build the world and drive through it.
        ground_truth_folder = ground_truth / sequence if ground_truth else None
        recorder, plan = self._recorder(self._entry_name(sequence), ground_truth_folder)
        scans = len(recorder.drive.scan_rows)
        points = 0
        block_scans = max(1, BLOCK_RAYS // len(recorder.lidar.directions))
        n_blocks = math.ceil(scans / block_scans)
        with closing(writer(self.logs, folder, sequence, recorder.lidar)) as logs:
            # 2. Write the poses.
            generators = partial(generator, recorder.seed, when=recorder.when)
            reference = reference_poses(
                recorder.drive, generators(Stream.GROUND_TRUTH), self.ground_truth_sd_m
            )
            logs.write_ground_truth(recorder.drive, reference, generators)

            # 3. Take the scans in blocks. Workers write them, unless they must be in order.
            worker = recorder if logs.in_order else replace(recorder, logs=logs)
            blocks = compute.rows(worker.block, scans, block_scans)
            for block_points, unwritten in watch.track(blocks, n_blocks, f"driving {sequence}"):
                points += block_points
                for scan, utime, returns in unwritten:
                    logs.write_scan(scan, utime, returns)
        return Recording(
            scans,
            points,
            metres=recorder.drive.length_m,
            unseen=plan.unseen,
            reversed=plan.reversed,
            unit=self._robot.unit,
        )

    def recorder(self, sequence: str) -> Recorder:
        """Make the recorder of a sequence, for scans without files; raises ConfigError."""
        recorder, _ = self._recorder(self._entry_name(sequence), None)
        return recorder

    def changes(self, train: str, sequence: str) -> list[Change]:
        """List the changes that are visible on the day of `sequence` but not on the training day.

        Their positions are in the frame of the ground truth. A scanner car has none, since all its
        logs are of one day. Raises ConfigError if `train` is not the training sequence, or for an
        unknown sequence.
        """
        if self._robot.loops:
            return []
        if train != self.training:
            raise ConfigError(
                f"train={train}: this world changes from the day of its first sequence, "
                f"{self.training}"
            )
        entry = Entry.of(sequence, self.sequences[self._entry_name(sequence)])
        campus, events = self.year_of(self.routes(), entry)
        return visible_changes(self.day_of(sequence), campus, events, origin_m(self.logs))

    def routes(self) -> Routes:
        """Plan the streets, and the route of the training sequence on them."""
        return training_routes(
            self.seed, self.blocks, self.route_m, self.route_file, self._robot.streets_only
        )

    def plan_of(self, entry: str) -> tuple[Routes, Plan]:
        """Plan the streets, and the route of the sequence with this entry.

        All sequences share a world, unless the robot drives loops: then each log has its own.
        """
        robot = self._robot
        shares = self.sequences[entry]
        if robot.loops:
            seed = (self.seed + LOG_SEEDS * (1 + int(entry))) % (MAX_SEED + 1)
            routes = loop_routes(seed, self.blocks, self.route_m, robot.streets_only, shares)
        else:
            routes = self.routes()
        if robot.loops or entry == self.training:
            return routes, routes.training
        return routes, routes.test(robot.departs(entry), shares)

    def _entry_name(self, sequence: str) -> str:
        """The name of a sequence's entry: its own name, or that of its log for a split of one."""
        name = kitti_log(sequence) if self._robot.loops else sequence
        if name not in self.sequences:
            raise ConfigError(
                f"sequence {sequence}: not in world.sequences ({', '.join(self.sequences)})"
            )
        return name

    def day_of(self, name: str) -> int:
        """The day of a sequence, counted from the training day."""
        departure = self._robot.departs(name)
        return departure.toordinal() - self._robot.departs(self.training).toordinal()

    def year_of(self, routes: Routes, entry: Entry) -> tuple[Campus, list[Event]]:
        """Build the campus of a sequence over the year, and the events by which it changes.

        Each thing on it has the days on which it stands.
        """
        route_km = routes.route_m / 1000
        count = round(self.events_per_km_of_route * route_km)
        wanted_count = round(entry.events_per_km * route_km)  # by the sequence's entry
        campus = build_campus(routes.seed, self.blocks, routes.streets, self.lining)
        return simulate_year(
            routes.seed,
            campus,
            routes.training.line_m,
            count,
            self.near_route,
            further=max(wanted_count - count, 0),
            further_near=entry.near_route,
        )

    def _recorder(self, name: str, ground_truth: Path | None) -> tuple[Recorder, Plan]:
        """Build the world and the drive of the sequence with the entry `name`."""
        routes, plan = self.plan_of(name)
        entry = Entry.of(name, self.sequences[name])
        robot = self._robot
        seed = routes.seed
        when = robot.departs(name)
        day = self.day_of(name)
        campus, events = self.year_of(routes, entry)
        driven = drive(
            seed,
            when,
            plan.line_m,
            campus.ground,
            route_m=routes.route_m,
            step_m=self.step_m,
            motion=robot.motion,
            lateral_m=entry.lateral_m,
            rocks_smoothly=self.turn_s > 0,
        )
        ground_truth_writer = GroundTruthWriter(ground_truth) if ground_truth else None
        if ground_truth_writer:
            shares = {
                "unseen": plan.unseen,
                "reversed": plan.reversed,
                "coverage": plan.coverage,
            }
            ground_truth_writer.write_year(day, events, shares)
        today = simulate_day(seed, campus, when, day, self.relief_m, self.twigs_per_m)
        lidar = replace(robot.lidar(self.azimuths), turn_s=self.turn_s)
        recorder = Recorder(
            seed,
            when,
            day=today,
            drive=driven,
            keep_off_m=robot.motion.keep_off_m,
            lidar=lidar,
            ground_truth=ground_truth_writer,
        )
        return recorder, plan
