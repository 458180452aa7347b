"""The simulated world's front door: a campus, a year, and the sequences driven in it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from pipeline.compute import Compute
from pipeline.errors import ConfigError
from pipeline.watch import Watch
from pipeline.world.campus import build_campus
from pipeline.world.day import dawn
from pipeline.world.drive import drive
from pipeline.world.events import pass_a_year
from pipeline.world.lidar import Lidar
from pipeline.world.odometry import integrate
from pipeline.world.plan import Plan, follow, half_edges_through, plan_test, plan_training
from pipeline.world.recorder import Recorder
from pipeline.world.route_file import read_route
from pipeline.world.seeds import Stream, generator
from pipeline.world.streets import Streets, add_route, lay_streets
from pipeline.world.writers import NcltWriter, TruthWriter

BLOCK_SCANS = 25
MIN_ROUTE_M = 30.0
TRAINING_ENTRY = {"unseen": 0.0, "reversed": 0.0}


@dataclass(frozen=True)
class Recording:
    """What a sequence came to."""

    scans: int
    points: int
    metres: float
    """Path length from the first scan to the last."""
    unseen: float
    """The share of the route on streets that the training sequence leaves out."""
    reversed: float
    """The share of the route on the training sequence's streets that is driven against its direction."""

    def __str__(self) -> str:
        driven = f"{self.scans} scans, {self.points / 1e6:.1f} M points, {self.metres:.0f} m driven"
        return f"{driven}; planned {self.unseen:.0%} unseen, {self.reversed:.0%} reversed"


@dataclass(frozen=True)
class Simulation:
    """A world and the sequences recorded in it; its fields are the keys of conf/world's yamls."""

    seed: int
    blocks: int
    """The campus has blocks × blocks blocks of about 95 m."""
    route_m: float
    """How far each sequence drives; with a `route_file`, at most the file's length."""
    step_m: float
    """Metres between scans."""
    azimuths: int
    """Rays per turn of each of the 32 beams."""
    sequences: Mapping[str, Mapping[str, float]]
    """Date -> {unseen, reversed}, the wanted shares of its route; the first is the training sequence, with zeros."""
    events_per_km_of_route: float = 3.0
    """Buildings that go up or come down in fifteen months; 14 is heavy."""
    near_route: float = 0.6
    """The share of those events near the training route."""
    route_file: str | None = None
    """The training route from a trajectory file of x, y columns or TUM rows, laid across the campus."""

    def __post_init__(self) -> None:
        for name in ("blocks", "route_m", "step_m", "azimuths"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"world.{name}={getattr(self, name)}: must be above 0")
        if not 0 <= self.seed < 1 << 20:
            raise ConfigError(f"world.seed={self.seed}: must lie in 0 to {(1 << 20) - 1}")
        if self.blocks < 2 or self.route_m < self.step_m:
            raise ConfigError(f"world.blocks={self.blocks}, route_m={self.route_m}: needs 2 blocks and a route of one step_m")
        if self.events_per_km_of_route < 0 or not 0 <= self.near_route <= 1:
            raise ConfigError("world.events_per_km_of_route must be 0 or more, world.near_route a share")
        if not self.sequences:
            raise ConfigError("world.sequences: needs at least the training sequence")
        for sequence, wanted in self.sequences.items():
            _date(sequence)
            if set(wanted) != set(TRAINING_ENTRY) or not all(0 <= share <= 1 for share in wanted.values()):
                raise ConfigError(f"world.sequences.{sequence}: needs unseen and reversed, each a share from 0 to 1")
        if dict(self.sequences[self.training]) != TRAINING_ENTRY:
            raise ConfigError(f"world.sequences.{self.training}: the first is the training sequence, unseen and reversed are 0")

    @property
    def training(self) -> str:
        """The sequence that the others are measured against."""
        return next(iter(self.sequences))

    def record(self, sequence: str, folder: Path, compute: Compute, watch: Watch, truth: Path | None = None) -> Recording:
        """Drive `sequence` and write its logs into `folder` in NCLT's layout; what no robot could know below `truth`.

        The bytes follow from the world's parameters, the training entry and the sequence's own date and entry. Raises
        ConfigError for a sequence that the table lacks, or a route file that cannot be driven.
        """
        if sequence not in self.sequences:
            raise ConfigError(f"sequence {sequence}: not in world.sequences ({', '.join(self.sequences)})")
        recorder, plan = self._prepare(sequence, folder, truth)
        scans = len(recorder.drive.scan_rows)
        blocks = compute.rows(recorder.block, scans, BLOCK_SCANS)
        written = list(watch.track(blocks, -(-scans // BLOCK_SCANS), f"driving {sequence}"))
        points = sum(block_points for _, block_points in written)
        return Recording(scans, points, recorder.drive.metres, plan.unseen, plan.reversed)

    def _prepare(self, sequence: str, folder: Path, truth: Path | None) -> tuple[Recorder, Plan]:
        """Build the world, drive through it, write everything but the scans."""
        today = _date(sequence)
        day = today.toordinal() - _date(self.training).toordinal()
        streets, training, route_m = self.plan_training()
        plan = self.plan(sequence, streets, training, route_m)
        campus = build_campus(self.seed, self.blocks, streets)
        count = round(self.events_per_km_of_route * route_m / 1000)
        campus, events = pass_a_year(self.seed, campus, training.line_m, count, self.near_route)
        driven = drive(self.seed, today, plan.line_m, campus.ground, route_m, self.step_m)

        logs = NcltWriter(folder, sequence)
        logs.open()
        logs.write_truth(driven.utimes, driven.world_T_body)
        drifted = integrate(generator(self.seed, Stream.ODOMETRY, today), driven.world_T_body)
        logs.write_odometry(driven.utimes, drifted)
        side = TruthWriter(truth, sequence) if truth else None
        if side:
            side.open()
            side.write_year(day, events, {"unseen": plan.unseen, "reversed": plan.reversed, "coverage": plan.coverage})
        return Recorder(self.seed, today, dawn(self.seed, campus, today, day), driven, Lidar(self.azimuths), logs, side), plan

    def plan_training(self) -> tuple[Streets, Plan, float]:
        """The streets, the training sequence's plan on them, and the metres that every sequence drives."""
        streets = lay_streets(generator(self.seed, Stream.STREETS), self.blocks)
        if self.route_file is None:
            return streets, plan_training(generator(self.seed, Stream.TRAINING_PLAN), streets, self.route_m), self.route_m
        route = read_route(Path(self.route_file))
        spans_m, campus_m = np.ptp(route, axis=0), np.ptp(streets.nodes_m, axis=0)
        if (spans_m > campus_m).any():
            raise ConfigError(
                f"route_file={self.route_file}: spans {spans_m[0]:.0f} × {spans_m[1]:.0f} m, the campus of blocks={self.blocks}"
                f" only {campus_m[0]:.0f} × {campus_m[1]:.0f} m"
            )
        streets, corners = add_route(streets, route)
        training = follow(streets, half_edges_through(streets, corners))
        length_m = float(np.hypot(*np.diff(training.line_m, axis=0).T).sum())
        if length_m < MIN_ROUTE_M:
            raise ConfigError(f"route_file={self.route_file}: only {length_m:.0f} m long, needs at least {MIN_ROUTE_M:.0f} m")
        return streets, training, min(self.route_m, length_m)

    def plan(self, sequence: str, streets: Streets, training: Plan, route_m: float) -> Plan:
        """The plan of `sequence`: the training one's own, or the walk nearest the wanted shares."""
        if sequence == self.training:
            return training
        wanted = self.sequences[sequence]
        rng = generator(self.seed, Stream.TEST_PLAN, _date(sequence))
        return plan_test(rng, streets, training, route_m, wanted["unseen"], wanted["reversed"])


def _date(sequence: str) -> date:
    try:
        return date.fromisoformat(sequence)
    except (TypeError, ValueError):
        raise ConfigError(f"sequence {sequence}: expected a date such as '2012-01-15'") from None
