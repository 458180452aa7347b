"""The simulated world: a yaml of conf/world in; the raw logs of its sequences out.

A world is a place, a year in which it changes, and a robot that drives through it on some days.
Logs are written in a real data set's format, with the truth beside them.
"""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, Share, check
from pipeline.formats.changes import Change
from pipeline.world.driving.day import TWIGS_PER_M, simulate_day
from pipeline.world.driving.drive import drive, survey
from pipeline.world.driving.entry import Entry
from pipeline.world.driving.recorder import Recorder, Recording
from pipeline.world.driving.robots import ROBOTS, Robot
from pipeline.world.layout.blocks import build_campus
from pipeline.world.layout.campus import Campus
from pipeline.world.layout.events import Event, simulate_year, visible_changes
from pipeline.world.layout.lining import Lining
from pipeline.world.layout.plan import Plan
from pipeline.world.layout.routes import Routes, loop_routes, training_routes
from pipeline.world.names import kitti_log
from pipeline.world.seeds import Stream, generator
from pipeline.world.writers import BAGS, Format, origin_m, writer
from pipeline.world.writers.truth import TruthWriter

BLOCK_RAYS = 400_000
"""Approximate number of rays in a block of scans."""
LOG_SEEDS = 7919
"""Between the seeds of a scanner car's logs, each of which is driven in a world of its own."""
MAX_SEED = (1 << 20) - 1
TRAINING_ENTRY = {"unseen": 0.0, "reversed": 0.0}


@dataclass(frozen=True)
class Simulation:
    """A world and the sequences recorded in it.

    Its fields are the keys of the yamls in conf/world.
    """

    seed: int
    blocks: Count
    """The world has blocks × blocks blocks of about 95 m."""
    route_m: Positive
    """Length of each sequence; with a `route_file`, at most the length of that route."""
    step_m: Positive
    """Metres between scans, or sweeps."""
    azimuths: Count
    """Rays per turn of each beam of the scanner; for a push-broom, rays per sweep."""
    sequences: Mapping[str, Mapping[str, float]]
    """Name -> settings of its Entry.

    The first is the training sequence: its shares are 0, and no other one changes it.
    """
    events_per_km_of_route: NotNegative = 3.0
    """Buildings built or demolished in fifteen months; 14 is very many."""
    near_route: Share = 0.6
    """The share of those events near the training route."""
    route_file: str | None = None
    """A trajectory file of x, y columns or TUM rows; the training sequence drives its route across
    the world."""
    robot: Literal["segway", "segway_inverted", "push_broom_car", "scanner_car"] = "segway"
    logs: Format = "nclt"
    """The format of the logs."""
    relief_m: NotNegative = 0.0
    """How far parts of a wall lie in front of its plane, or behind it, at most."""
    twigs_per_m: NotNegative = TWIGS_PER_M
    """Extinction of a bare deciduous tree."""
    lining: Lining = "sparse"
    """What stands close along the streets: `street`, narrow and lined with houses, gardens and
    cars; `campus`, hedges, low walls and bushes beside its ways; or `sparse`, nothing."""
    turn_s: NotNegative = 0.0
    """How long the scanner takes for a turn, in which the robot drives on; bags say when each point
    was measured. 0: a scan is taken at one moment."""
    truth_sd_m: NotNegative = 0.0
    """Standard deviation of the written truth, which wanders about the driven path as SLAM's does;
    0: it is exact."""

    def __post_init__(self) -> None:
        check(self, "world")
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
        return ROBOTS[self.robot]

    def record(
        self,
        sequence: str,
        folder: Path,
        compute: Compute,
        watch: Progress,
        truth: Path | None = None,
    ) -> Recording:
        """Drive `sequence` and write its logs into `folder`.

        Labels that no robot could record go into `truth`/sequence. The bytes depend only on the
        parameters of the world, the training entry, and the name and entry of the sequence. Raises
        ConfigError for a sequence without an entry, or a route file that cannot be driven.
        """
        recorder, plan = self._recorder(
            self._entry_name(sequence), truth / sequence if truth else None
        )
        scans = len(recorder.drive.scan_rows)
        points = 0
        block = max(1, BLOCK_RAYS // len(recorder.lidar.directions))
        with closing(writer(self.logs, folder, sequence, recorder.lidar)) as logs:
            generators = partial(generator, recorder.seed, when=recorder.when)
            logs.write_truth(
                recorder.drive,
                survey(recorder.drive, generators(Stream.TRUTH), self.truth_sd_m),
                generators,
            )
            blocks = compute.rows(
                replace(recorder, logs=None if logs.in_order else logs).block, scans, block
            )
            for block_points, unwritten in watch.track(
                blocks, -(-scans // block), f"driving {sequence}"
            ):
                points += block_points
                for scan in unwritten:
                    logs.write_scan(*scan)
        return Recording(
            scans, points, recorder.drive.metres, plan.unseen, plan.reversed, self._robot.unit
        )

    def recorder(self, sequence: str) -> Recorder:
        """What records `sequence`, for scans that need no file; raises ConfigError as `record`."""
        return self._recorder(self._entry_name(sequence), None)[0]

    def changes(self, train: str, sequence: str) -> list[Change]:
        """The changes that are visible on the day of `sequence` but not on the training day.

        They are in the frame of the truth. Empty for a scanner car, whose logs are all of one day.
        Raises ConfigError where `train` is not the training sequence, or for an unknown sequence.
        """
        if self._robot.loops:
            return []
        if train != self.training:
            raise ConfigError(
                f"train={train}: this world changes from the day of its first sequence, "
                f"{self.training}"
            )
        campus, events = self.year_of(
            self.routes(), Entry.of(sequence, self.sequences[self._entry_name(sequence)])
        )
        return visible_changes(self.day_of(sequence), campus, events, origin_m(self.logs))

    def routes(self) -> Routes:
        """The streets, and the plan of the training sequence on them."""
        return training_routes(
            self.seed, self.blocks, self.route_m, self.route_file, self._robot.streets_only
        )

    def plan_of(self, entry: str) -> tuple[Routes, Plan]:
        """The streets and the plan of a sequence.

        They lie in the one world of all sequences, or in the own world of a log.
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
        """The name of the entry of a sequence: its own, or that of its log."""
        name = kitti_log(sequence) if self._robot.loops else sequence
        if name not in self.sequences:
            raise ConfigError(
                f"sequence {sequence}: not in world.sequences ({', '.join(self.sequences)})"
            )
        return name

    def day_of(self, name: str) -> int:
        """The day of a sequence, counted from that of the training sequence."""
        departure = self._robot.departs(name)
        return departure.toordinal() - self._robot.departs(self.training).toordinal()

    def year_of(self, routes: Routes, entry: Entry) -> tuple[Campus, list[Event]]:
        """The campus over the year of a sequence, each thing with the days on which it stands.

        And the events by which it changes.
        """
        route_km = routes.route_m / 1000
        count = round(self.events_per_km_of_route * route_km)
        entry_count = round(entry.events_per_km * route_km)
        campus = build_campus(routes.seed, self.blocks, routes.streets, self.lining)
        line_m = routes.training.line_m
        return simulate_year(
            routes.seed,
            campus,
            line_m,
            count,
            self.near_route,
            max(entry_count - count, 0),
            entry.near_route,
        )

    def _recorder(self, name: str, truth: Path | None) -> tuple[Recorder, Plan]:
        """Build the world and the drive of a sequence.

        Writes the events of its year below `truth`.
        """
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
            routes.route_m,
            self.step_m,
            robot.motion,
            entry.lateral_m,
            rocks_smoothly=self.turn_s > 0,
        )
        side = TruthWriter(truth) if truth else None
        if side:
            side.write_year(
                day,
                events,
                {"unseen": plan.unseen, "reversed": plan.reversed, "coverage": plan.coverage},
            )
        today = simulate_day(seed, campus, when, day, self.relief_m, self.twigs_per_m)
        lidar = replace(robot.lidar(self.azimuths), turn_s=self.turn_s)
        return Recorder(seed, when, today, driven, robot.motion.keep_off_m, lidar, side), plan
