"""A level site: the map of a building, in which the sweeps of a level 2-D laser are localised.

A single sweep tells little in a corridor. So the sweeps of the last metres of a drive are gathered
by the robot's odometry (METHODS 13.5).
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, transformed
from pipeline.formats.bag import SWEEP
from pipeline.level.field import Field
from pipeline.level.fix import LevelFix
from pipeline.level.level_map import LevelMap
from pipeline.level.sweeps import Gathered, Gatherer, single
from pipeline.level.verdict import OF_SWEEPS
from pipeline.mapping.appearance import is_level
from pipeline.matching.ranking import Ranking
from pipeline.online.motion import Step
from pipeline.online.site import CLAIM_VERDICTS, NO_PLACE, Fix, Site
from pipeline.online.site_file import LevelParts
from pipeline.online.site_json import LevelDescription
from pipeline.posing.prior import Prior
from pipeline.posing.verdict import AnyFix, Judge

FEW_POINTS = 20
"""Up to this many points, a level sweep cannot be told from a 3-D scan; they give no pose anyway.
"""


class LevelSite(Site):
    """A building in which level sweeps can be localised."""

    is_level = True
    gathers = True
    message = SWEEP

    # callers use only the fields that both kinds of description have
    description: LevelDescription  # type: ignore[assignment]

    def __init__(self, parts: LevelParts) -> None:
        """Build a level site from the content of its file."""
        self.description = parts.description
        level = parts.description.level
        x_m, y_m, yaw_rad = level.origin
        occupancy = np.asarray(parts.arrays["occupancy"], np.int8)
        self.level_map = LevelMap(occupancy, level.cell_m, (x_m, y_m, yaw_rad))
        self.field = Field.of(self.level_map)
        self.over_m = level.over_m
        self.level_fixer = level.fixer
        verdict = parts.description.verdict
        self.claim_judge = Judge(verdict.pose, verdict.place, OF_SWEEPS)
        self.calibrated = verdict.calibrated
        self.target_precisions = verdict.thresholds

    @property
    def path_m(self) -> None:
        """A level site keeps no path."""
        return None

    def walls_of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """All hits (n, 3) of a sweep, since no hit lies on the ground."""
        return points_m

    def unlike(
        self, points_m: NDArray[np.float64], body_T_lidar: Poses | None, *ways: tuple[str, str]
    ) -> list[str]:
        """No warnings, since a level site does not describe its sensor."""
        return []

    @cached_property
    def walls_m(self) -> NDArray[np.float64]:
        """The centres (n, 3) of the cells that are walls, in metres in the world, at z = 0."""
        cells = np.argwhere(self.level_map.walls)[:, ::-1]  # column, row
        grid_m = (cells + 0.5) * self.level_map.cell_m
        world_m = transformed(self.level_map.world_T_grid, grid_m)
        return np.column_stack([world_m, np.zeros(len(world_m))])

    def drive(self) -> "SweepDrive":
        """A new drive, whose sweeps are gathered."""
        return SweepDrive(self.over_m)

    def points(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The finite hits (n, 2) of a level sweep; raises InputError for a 3-D scan."""
        return level_points(points_m)

    def single(self, points_m: NDArray[np.floating]) -> Gathered:
        """A single sweep's hits (n, 2) or (n, 3), as a query; raises InputError for a 3-D scan."""
        return single(level_points(points_m))

    def seek(self, query: Gathered, prior: Prior | None = None) -> LevelFix:
        """The poses that gathered sweeps may have in the whole map.

        With a prior, those within it, and the best rivals of these elsewhere.
        """
        return self.level_fixer.fix(self.field, query, prior)

    def track(self, query: Gathered, world_T_guess: NDArray[np.float64]) -> LevelFix:
        """The pose of gathered sweeps near a guess (4, 4)."""
        return self.level_fixer.track(self.field, query, world_T_guess)

    def judge_query(
        self,
        query: Gathered,
        registered: AnyFix,
        target_precision: float | None,
        is_tracked: bool = False,
    ) -> Fix:
        """The fix of gathered sweeps, rejected if the laser may be mounted otherwise than given.

        The mounting of tracked sweeps is checked only if odometry contradicts them.
        """
        ordered = registered.ordered(self.claim_judge.pose)
        fix = self.judge(ordered, target_precision)
        if fix.verdict not in CLAIM_VERDICTS or (is_tracked and not query.is_contradicted):
            return fix
        if not self.level_fixer.is_misread(self.field, query, ordered):
            return fix
        return replace(fix, verdict="rejected", novelty=1.0, place_novelty=1.0, accepted_at=None)

    def rank(self, points_m: NDArray[np.float64], prior: Prior | None = None) -> Ranking:
        """A level site ranks no places; raises InputError."""
        raise InputError("a level site: it has no places to rank, only a map to search")

    def place(self, world_T_query: NDArray[np.float64]) -> int:
        """A level site has no places."""
        return NO_PLACE


class SweepDrive:
    """The drive of a robot with a level laser, whose sweeps are gathered by odometry."""

    counts_no_pose = False  # a sweep without a pose has too few hits, wherever it was taken
    widens = False

    def __init__(self, over_m: float) -> None:
        self._over_m = over_m
        self.new_view_m = over_m  # sweeps that are gathered twice are no new evidence
        self._gatherer = Gatherer()

    def query(self, points_m: NDArray[np.float64], step: NDArray[np.float64] | None) -> Gathered:
        """The sweep's hits (n, 2) with those of the last metres of path."""
        self._gatherer.add(points_m, step)
        return self._gatherer.gathered(self._over_m)

    def step(self, step: NDArray[np.float64] | None, took_s: float | None) -> Step:
        """The step by odometry (4, 4), corrected by matching the sweep of the last `query`.

        Without odometry the robot may be anywhere.
        """
        if step is None or not np.isfinite(step).all():
            return Step(np.eye(4), is_anywhere=True)
        matched = self._gatherer.matched_step
        if matched is None:
            return Step(step)
        before_T_now = np.eye(4)
        before_T_now[:2, [0, 1, 3]] = matched[:2]
        return Step(before_T_now)

    def note_fix(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Do nothing: no motion is predicted."""

    def lose(self) -> None:
        """Forget all sweeps but the newest."""
        self._gatherer.restart()


def level_points(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The finite hits (n, 2) of a level sweep's points (m, 2) or (m, 3), in metres.

    Raises InputError for points of another shape or type, and for a 3-D scan.
    """
    points_m = np.asarray(points_m)
    if points_m.ndim != 2 or points_m.shape[1] not in (2, 3) or points_m.dtype.kind not in "fiu":
        raise InputError(
            f"points of shape {points_m.shape} and type {points_m.dtype}: expected numbers (n, 2) "
            "or (n, 3), in metres"
        )
    points_m = points_m.astype(np.float64)
    points_m = points_m[np.isfinite(points_m).all(axis=1)]
    if points_m.shape[1] == 3 and len(points_m) > FEW_POINTS and not is_level([points_m]):
        raise InputError(
            f"a 3-D scan, its points lie over {np.ptp(points_m[:, 2]):.1f} m of height: this site "
            "is level, it takes the sweeps of a level 2-D laser"
        )
    return np.ascontiguousarray(points_m[:, :2])
