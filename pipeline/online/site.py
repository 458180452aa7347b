"""A site: all that it takes to localise scans in a place, opened from one file.

A scan goes in, a `Fix` comes out: its pose, and whether to accept it (METHODS 10.1).

1. The method ranks the places for the scan (`rank`).
2. The scan is registered with the map at these places, then all over the map (`register`). The
   result is hypotheses: poses that it may have.
3. The verdict that was learned with the site says which claims to accept (`judge`).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.errors import ArtifactError, InputError, NotInstalledError, YearlocError
from pipeline.core.frames import Poses, transformed
from pipeline.formats.bag import CLOUD
from pipeline.mapping.appearance import is_level
from pipeline.mapping.from_above import standing
from pipeline.matching.correlation import WallMap
from pipeline.matching.places import Places
from pipeline.matching.ranking import Localizer, Ranking, Rows
from pipeline.networks.plain import Plain
from pipeline.online.motion import Drive, ScanDrive
from pipeline.online.runtime import exported, localizer
from pipeline.online.site_file import Arrays, LevelParts, Parts, read, read_either
from pipeline.online.site_json import SiteDescription, notes
from pipeline.posing import covariances
from pipeline.posing.cut_outs import CutOuts
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import ScanFix as Registered
from pipeline.posing.prior import Prior
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import CLAIMS, AnyFix, Judge

ROOTS = (
    "pipeline.methods.",
    "pipeline.views.",
    "pipeline.posing.",
    "pipeline.matching.correlation",
)
"""A site file may name classes of these modules only."""
LEVEL_SITE = ("pipeline.online.level_site", "LevelSite")
"""The module and class of a level site. It is a Site, so its module imports this one; it is
imported here only when it is needed."""
HEIGHT_SETTINGS = ("colormap", "h_min_m", "h_max_m")
"""Settings of a method that map heights to the input of its network."""
NO_PLACE = -1
"""The place of a pose outside of all places."""
RUNNERS_UP = 4
"""How many other poses a fix lists at most."""
FARTHEST_M = 1e3
"""Points farther from the origin are dropped: no lidar reaches so far."""
SWEEP_POINTS = 50
"""With fewer points, a level sweep cannot be told from a 3-D scan; they give no pose anyway."""
WALLS_M = (0.3, np.inf)
"""The heights of walls; points below are ground, which would hide the walls."""
VerdictName = Literal["accepted", "near", "ambiguous", "rejected", "no pose"]
"""The verdict on a fix, at the caller's target precision.

- accepted: the pose is right, within 2 m and 5° (in a level site 1 m and 10°).
- near: the pose may be wrong, but the robot is within 15 m of it (in a level site 5 m).
- ambiguous: the robot has the pose, or that of a runner-up.
- rejected: none of these is accepted.
- no pose: there are too few points, or nothing fits.
"""
CLAIM_VERDICTS: tuple[VerdictName, ...] = ("accepted", "near", "ambiguous")
"""The verdict if a claim of CLAIMS (posing/verdict.py) is accepted: the pose is right, the place is
right, or the pose or a runner-up is right. A claim is accepted if its error probability, one minus
its probability, is below a threshold."""
NO_THRESHOLDS = (0.0,) * len(CLAIMS)
"""With these thresholds nothing is accepted."""


@dataclass(frozen=True)
class RunnerUp:
    """Another pose that the scan may have instead of the best one; see Fix for its fields."""

    place: int
    world_T_sensor: NDArray[np.float64]
    overlap: float
    probability: float
    """The probability that this pose is right."""


@dataclass(frozen=True)
class Fix:
    """Where a scan was taken, and whether to accept it."""

    verdict: VerdictName
    place: int
    """The grid cell of the pose; −1 outside of all cells that training visited."""
    world_T_sensor: NDArray[np.float64]
    """(4, 4) the pose of the frame that the points were given in; NaN without a pose."""
    covariance: NDArray[np.float64]
    """(6, 6) of a small turn about x, y, z in radians, then of a step along x, y, z in metres, in
    the frame of the points; calibrated (METHODS 9.5), in a level site not. `yearloc localize` and
    the server write it as ROS does: x, y, z first, along the world's axes."""
    overlap: float
    """The share of the scan's voxels that the map has within half a metre; in a level site, the
    share of beams that end at a wall of the map."""
    novelty: float
    """One minus the probability that the pose is right."""
    place_novelty: float
    """One minus the probability that the robot is within 15 m of the pose (in a level site 5 m)."""
    target_precision: float | None
    """The precision that `accepted` means for this fix: the wanted one, or what the site keeps
    instead (`Site.kept_precision`); None if nothing is accepted."""
    accepted_at: float | None
    """The highest target precision at which this pose is accepted; None if there is none."""
    runners_up: tuple[RunnerUp, ...]
    """Other poses, the likeliest first: 5 m or more away (in a level site 1 m or 20°)."""
    ms: float
    """Milliseconds from points to fix."""

    @property
    def probability(self) -> float:
        """The probability that the pose is right."""
        return 1 - self.novelty


class Site:
    """A place in which scans can be localised, with the method, map and verdict of its file."""

    is_level = False
    """Whether it localises the sweeps of a level 2-D laser, not 3-D scans."""
    gathers = False
    """Whether it gathers scans along a drive, and so uses their odometry also without tracking."""
    message: ClassVar[str] = CLOUD
    """The type of the messages in a bag that it localises."""

    def __init__(self, parts: Parts, threads: int = 1) -> None:
        """Build a site from the content of its file; `threads` is for the network."""
        description, model, arrays, network, _ = parts
        self.description = description
        # the network: as it was exported, in plain numpy if it is small enough, or in torch
        if network is not None:
            self.localizer: Localizer = localizer(exported(network, threads), model)
        elif threads == 1 and Plain.is_in(model):
            height_settings = {
                key: description.method[key] for key in HEIGHT_SETTINGS if key in description.method
            }
            self.localizer = localizer(Plain.of(model, **height_settings), model)
        else:
            method = build({**description.method, "threads": threads}, ROOTS)
            self.localizer = method.localizer(model)
        self.view: Callable[[NDArray[np.floating]], NDArray[Any]] = build(description.view, ROOTS)
        self.targets = _targets(description, model, arrays)
        self.places = Places(description.places, arrays["cells"])
        verdict = description.verdict
        if verdict.covariances is None:  # a file of an earlier yearloc
            verdict = replace(verdict, covariances=covariances.USUAL)
        self.calibrated = verdict.calibrated
        self.claim_judge = Judge(verdict.pose, verdict.place)
        self.fixer: Fixer = replace(
            build(description.fixer, ROOTS),
            model=self.claim_judge.pose,
            expectations=Expectations.of_arrays(arrays),
        )
        self.target_precisions: dict[float, tuple[float, ...]] = verdict.thresholds
        """For each target precision that a pose can reach, the thresholds on the error
        probabilities of CLAIMS."""
        self.k = description.k

    @classmethod
    def open(cls, path: str | Path, threads: int = 1, level: bool = True) -> Self:
        """Open a site file. A level site is opened too, as a LevelSite, unless `level` is False.

        `threads` is for the network. Raises ArtifactError for a file that is not whole or of
        another version, NotInstalledError if a package that it needs is missing.
        """
        path = Path(path)
        parts = read_either(path) if level else read(path)
        try:
            if isinstance(parts, LevelParts):
                module, name = LEVEL_SITE
                return cast(Self, getattr(import_module(module), name)(parts))
            return cls(parts, threads)
        except NotInstalledError:
            raise
        except (
            KeyError,
            TypeError,
            ValueError,
            AttributeError,
            RuntimeError,
            IndexError,
            YearlocError,
        ) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ArtifactError(
                f"{path}: its parts do not fit together ({reason}); pack the site again"
            ) from None

    @classmethod
    def of_map(cls, points_m: NDArray[np.floating], name: str = "map", threads: int = 1) -> Self:
        """The site of a 3-D map's points (n, 3), in metres, z upwards; see `yearloc pack --map`.

        Its verdict is not calibrated. Raises InputError for points of another shape, and for a map
        in which nothing can be localised.
        """
        from pipeline.online.map_pack import MapOptions, parts_of_points  # imports this module

        return cls(parts_of_points(points_m, name, MapOptions()), threads)

    @property
    def name(self) -> str:
        """STUDY/GRID/MODEL of the model that was packed; of a map, its name."""
        return self.description.name

    @property
    def title(self) -> str:
        """The name, and what must be said of the site: simulated, not calibrated on this map."""
        return ", ".join((self.name, *notes(self.description)))

    def kept_precision(self, target_precision: float | None, strict: bool = False) -> float | None:
        """The precision that is kept if this one is wanted; None accepts nothing.

        It is the least from it on that the site has a threshold for; if there is none, the largest
        below it. Raises InputError for a precision that is not a share; if `strict`, for each that
        the site has no threshold for.
        """
        return self.description.verdict.kept_precision(target_precision, strict)

    def kept_words(self, target_precision: float | None) -> str | None:
        """A line that says which precision is kept instead of this one; None if this one is."""
        return self.description.verdict.kept_words(target_precision)

    def localize(
        self,
        points_m: NDArray[np.floating],
        target_precision: float | None = 0.99,
        prior: Prior | None = None,
        strict: bool = False,
    ) -> Fix:
        """Localise a scan's points (n, 3) in metres: x forward, y left, z up, ground at z = 0.

        Points that are not finite are dropped. The fix is accepted if it is right at
        `target_precision` or, if the site has no threshold for it, at what the site keeps instead
        (`kept_precision`); None accepts nothing. With a prior, the pose is sought
        within it first; see `find`. Raises InputError for points of another shape, for a target
        precision that is not a share and, if `strict`, for one that the site has no threshold for.
        """
        start = time.perf_counter()
        target_precision = self.kept_precision(target_precision, strict)
        query = self.single(points_m)
        fix = self.find(query, target_precision, prior)
        return replace(fix, ms=1e3 * (time.perf_counter() - start))

    def find(self, query: Any, target_precision: float | None, prior: Prior | None = None) -> Fix:
        """The fix of a query, without regard to scans before; its time `ms` is yet to be filled in.

        With a prior, the pose is sought within it. If it is not accepted there, it is sought in the
        whole map as without a prior: so a wrong prior costs time. With the target precision None,
        it must be accepted at any target precision within the prior.
        """
        registered = self.sought(query, target_precision, prior)
        return self.judge_query(query, registered, target_precision)

    def sought(
        self, query: Any, target_precision: float | None, prior: Prior | None = None
    ) -> AnyFix:
        """The poses that a query may have: within a prior if one is accepted there, else all."""
        if prior is not None:
            registered = self.seek(query, prior)
            fix = self.judge_query(query, registered, target_precision)
            is_accepted_at_any = target_precision is None and fix.accepted_at is not None
            if fix.verdict == "accepted" or is_accepted_at_any:
                return registered
        return self.seek(query)

    def drive(self) -> Drive:
        """What a Tracker remembers of a new drive."""
        return ScanDrive()

    def points(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The finite points (n, 3) of a scan; raises InputError for another shape or type."""
        return finite(points_m)

    def single(self, points_m: NDArray[np.floating]) -> Any:
        """The query of a single scan; raises InputError for a level sweep."""
        points_m = self.points(points_m)
        if len(points_m) >= SWEEP_POINTS and is_level([points_m]):
            raise InputError(
                "a level sweep, all in one plane: this site is of 3-D scans; `yearloc pack` makes "
                "a level site of a data set of level sweeps, or of a Nav2 map"
            )
        return points_m

    def seek(self, query: Any, prior: Prior | None = None) -> AnyFix:
        """The poses that a query, a scan's points (n, 3), may have in the whole map.

        With a prior, those within it alone, and of rivals the first of the ranking.
        """
        answers = Answers.of(self.rank(query, prior))
        return self.fixer.fix(query, self.targets, answers, prior=prior)

    def track(self, query: Any, world_T_guess: NDArray[np.float64]) -> AnyFix:
        """The poses of a query, a scan's points (n, 3), near a guess (4, 4)."""
        return self.fixer.track(query, self.targets, world_T_guess)

    def rank(self, points_m: NDArray[np.float64], prior: Prior | None = None) -> Ranking:
        """The method's ranking of places for one scan (n, 3), as a ranking of one query.

        In a 3-D map, which is long to search from above, only positions within a prior are ranked.
        """
        localizer = self.localizer
        if prior is not None and self.targets.is_map:
            from pipeline.methods.bev_correlation import BevLocalizer  # takes long to import

            if isinstance(localizer, BevLocalizer):
                localizer = localizer.near(prior.xy_m, prior.reach_m)
        # the stamp and the pose of a single query are not used
        stamps_ns = np.zeros(1, np.int64)
        poses = np.eye(4)[None]
        return localizer(Rows(self.view(points_m)[None], stamps_ns, poses), self.k)

    def register(self, points_m: NDArray[np.float64], answers: Answers) -> Registered:
        """Register a scan's finite points (n, 3) at a ranking's answers, then all over the map.

        Returns posing's Fix (here called Registered): hypotheses without a verdict.
        """
        return self.fixer.fix(points_m, self.targets, answers)

    def judge_query(
        self,
        query: Any,
        registered: AnyFix,
        target_precision: float | None,
        is_tracked: bool = False,
    ) -> Fix:
        """The fix of a registered query; its time `ms` is yet to be filled in.

        `is_tracked` says that its hypotheses were sought only near a guess.
        """
        return self.judge(registered, target_precision)

    def judge(self, registered: AnyFix, target_precision: float | None) -> Fix:
        """The fix of a registered scan, with its verdict at a target precision that is kept.

        The hypotheses are in the order of their probabilities. The time `ms` is yet to be filled
        in.
        """
        if not registered.hypotheses:
            return no_pose(registered.covariance, target_precision)
        # rounded like the error probabilities from which the thresholds were learned
        error_probabilities = (
            self.claim_judge.error_probabilities(registered).astype(np.float32).astype(np.float64)
        )
        pose_error, place_error, _ = error_probabilities.tolist()
        verdict, accepted_at = self.verdict_of(error_probabilities, target_precision)
        runners_up = []
        for number in registered.elsewhere[:RUNNERS_UP]:
            other = registered.hypotheses[number]
            runners_up.append(
                RunnerUp(
                    self.place(other.world_T_query),
                    other.world_T_query,
                    other.overlap,
                    registered.probabilities[number],
                )
            )
        return Fix(
            verdict=verdict,
            place=self.place(registered.pose),
            world_T_sensor=registered.pose,
            covariance=self.calibrated(registered.covariance),
            overlap=registered.overlap,
            novelty=pose_error,
            place_novelty=place_error,
            target_precision=target_precision,
            accepted_at=accepted_at,
            runners_up=tuple(runners_up),
            ms=0.0,
        )

    def verdict_of(
        self, error_probabilities: NDArray[np.float64], target_precision: float | None
    ) -> tuple[VerdictName, float | None]:
        """The verdict on a fix with a pose, from the error probabilities (claim,) of its claims.

        Returns the first of CLAIM_VERDICTS whose claim is accepted at the target precision, and the
        highest target precision at which the pose is accepted, or None.
        """
        thresholds = (
            NO_THRESHOLDS
            if target_precision is None
            else self.target_precisions.get(target_precision, NO_THRESHOLDS)
        )
        verdict: VerdictName = "rejected"
        for word, error_probability, threshold in zip(
            CLAIM_VERDICTS, error_probabilities, thresholds, strict=True
        ):
            if error_probability < threshold:
                verdict = word
                break
        met_precisions = [
            precision
            for precision, (pose_threshold, *_) in self.target_precisions.items()
            if error_probabilities[0] < pose_threshold
        ]
        return verdict, max(met_precisions, default=None)

    @property
    def path_m(self) -> NDArray[np.float64] | None:
        """The training path (n, 3) in metres in the world; None if the site has no path."""
        if self.targets.is_map:
            return None
        return np.asarray(self.targets.world_T_anchor[:, :3, 3])

    def walls_of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The points (n, 3) of a scan without the ground."""
        return standing(points_m, WALLS_M)

    @property
    def walls_m(self) -> NDArray[np.float64]:
        """The points (n, 3) of all walls of the map, in metres in the world."""
        if isinstance(self.targets, CutOuts):
            return self.targets.above_ground_m(WALLS_M[0])
        walls_m = [
            transformed(world_T_anchor, self.walls_of(self.targets.points_m(row)))
            for row, world_T_anchor in enumerate(self.targets.world_T_anchor)
        ]
        return np.concatenate(walls_m)

    def unlike(
        self, points_m: NDArray[np.float64], body_T_lidar: Poses | None, *ways: tuple[str, str]
    ) -> list[str]:
        """Warnings if the sensor of a scan (n, 3) is unlike the site's: see sensor.unlike."""
        from pipeline.online.sensor import unlike  # takes long to import

        return unlike(points_m, self.description.sensor, body_T_lidar, *ways)

    def place(self, world_T_query: NDArray[np.float64]) -> int:
        """The place that a pose (4, 4) lies in."""
        return int(self.places.at(world_T_query[None, :2, 3])[0])


def drawn_walls(description: SiteDescription, arrays: Arrays) -> Arrays:
    """The arrays of the map of walls of a drive's site: it is drawn once, not by each robot."""
    settings = description.map
    targets = Targets(arrays, settings.grain_m, settings.range_m, settings.single)
    fixer: Fixer = build(description.fixer, ROOTS)
    nothing = np.zeros(len(targets.world_T_anchor), bool)
    return targets.wall_map(fixer.whole_map, nothing).arrays


def _targets(
    description: SiteDescription, model: Mapping[str, NDArray[Any]], arrays: Arrays
) -> Targets:
    """What scans are registered with: the submaps of a drive, or cut-outs of a 3-D map."""
    settings = description.map
    if not settings.is_tiled:
        return Targets(arrays, settings.grain_m, settings.range_m, settings.single)
    drawn = WallMap.of_arrays(model, float(description.method["cell_m"]))
    return CutOuts(arrays, drawn, settings.grain_m, settings.range_m)


def no_pose(covariance: NDArray[np.float64], target_precision: float | None = None) -> Fix:
    """The fix of a scan without a pose; `covariance` (6, 6) is infinite or NaN."""
    return Fix(
        verdict="no pose",
        place=NO_PLACE,
        world_T_sensor=np.full((4, 4), np.nan),
        covariance=covariance,
        overlap=0.0,
        novelty=1.0,
        place_novelty=1.0,
        target_precision=target_precision,
        accepted_at=None,
        runners_up=(),
        ms=0.0,
    )


def finite(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The points (n, 3) that are finite and within FARTHEST_M on each axis.

    Raises InputError for points of another shape or type.
    """
    points_m = np.asarray(points_m)
    if points_m.ndim != 2 or points_m.shape[1] != 3 or points_m.dtype.kind not in "fiu":
        raise InputError(
            f"points of shape {points_m.shape} and type {points_m.dtype}: expected numbers (n, 3), "
            "in metres"
        )
    points_m = points_m.astype(np.float64)
    return np.asarray(points_m[(np.abs(points_m) < FARTHEST_M).all(axis=1)])
