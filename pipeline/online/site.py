"""A site: all that localising in a place needs, in one file, without DVC, Hydra or MLflow."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.errors import ArtifactError, InputError, NotInstalledError, YearlocError
from pipeline.mapping.appearance import is_level
from pipeline.matching.places import Places
from pipeline.matching.ranking import Localizer, Ranking, Rows
from pipeline.networks.plain import Plain
from pipeline.online.runtime import exported, localizer
from pipeline.online.site_file import LevelParts, Parts, read, read_either
from pipeline.online.site_json import Promises
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Fix as Registered
from pipeline.posing.fix import Hypothesis
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import BELIEFS, Judge

ROOTS = ("pipeline.methods.", "pipeline.views.", "pipeline.posing.")
LEVEL_SITE = ("pipeline.online.level_site", "LevelSite")
"""What a level site is opened as: a Site too, so its module imports this one."""
LOOKS = ("colormap", "h_min_m", "h_max_m")
"""Settings of a method by which a network looks at heights."""
RUNNERS_UP = 3
FARTHEST_M = 1e3  # no lidar sees farther
SWEEP_POINTS = 50
"""Fewer points may be of any laser; they make no pose."""
Word = Literal["accepted", "near", "ambiguous", "rejected", "no pose"]
"""The verdict on a fix, with the promise that was asked for.

Accepted: the pose is right within 2 m and 5°, of a level site within 1 m and 10°. Near: that is
not believed, but that the robot is within 15 m of the pose is, of a level site within 5 m.
Ambiguous: it has the pose or that of a runner-up. Rejected: nothing is believed. No pose: too few
points, or nothing fits.
"""
NO_LIMITS = (0.0,) * len(BELIEFS)
"""Limits that accept nothing: no doubt is below them."""
WORDS: tuple[Word, ...] = ("accepted", "near", "ambiguous")
"""The verdict for each of BELIEFS."""


@dataclass(frozen=True)
class RunnerUp:
    """Another pose that the scan may have, which contradicts the best one."""

    place: int
    world_T_sensor: NDArray[np.float64]
    overlap: float
    chance: float
    """Chance that it is right."""


@dataclass(frozen=True)
class Fix:
    """Where a scan was taken, and whether to believe it."""

    verdict: Word
    place: int
    """The grid cell of the pose; −1 outside all cells that training visited."""
    world_T_sensor: NDArray[np.float64]
    """(4, 4) of the frame that the points were given in; NaN without a pose."""
    covariance: NDArray[np.float64]
    """(6, 6) of a turn about x, y, z in radians, then of a step along x, y, z in metres, in the
    frame of the points; what `yearloc localize` and the server write is x, y, z first, along the
    world's axes, as in ROS."""
    overlap: float
    """Share of the scan's voxels that the map has within half a metre; of a level site, of the
    beams that end at a wall of the map."""
    novelty: float
    """One minus the chance that the pose is right."""
    place_novelty: float
    """One minus the chance that the robot is within 15 m of it; of a level site, within 5 m."""
    promised_precision: float | None
    """The highest precision promised on held-out blocks that this fix keeps; None of none."""
    runners_up: tuple[RunnerUp, ...]
    """Poses elsewhere, the likeliest first: 5 m or more away, of a level site 1 m or 20°."""
    ms: float
    """Milliseconds from points to fix."""


class Site:
    """A place that scans can be localised in: method, map and verdict of one site file."""

    is_level = False
    """Whether it is asked with the sweeps of a level 2-D laser, not with 3-D scans."""

    def __init__(self, parts: Parts, threads: int = 1) -> None:
        """Build a site from the content of its file.

        Networks of SCI and of its ring answer on one thread without torch.
        """
        description, model, arrays, network, _ = parts
        self.description = description
        if network is not None:
            self.localizer: Localizer = localizer(exported(network, threads), model)
        elif threads == 1 and Plain.is_in(model):
            looks = {key: description.method[key] for key in LOOKS if key in description.method}
            self.localizer = localizer(Plain.of(model, **looks), model)
        else:
            method = build({**description.method, "threads": threads}, ROOTS)
            self.localizer = method.localizer(model)
        self.view: Callable[[NDArray[np.floating]], NDArray[Any]] = build(description.view, ROOTS)
        self.targets = Targets(arrays, **vars(description.map))
        self.places = Places(description.places, arrays["cells"])
        verdict = description.verdict
        self.judged = Judge(verdict.pose, verdict.place)
        self.fixer: Fixer = replace(
            build(description.fixer, ROOTS),
            chances=self.judged.pose,
            expectations=Expectations.of_arrays(arrays),
        )
        self.promises: dict[float, tuple[float, ...]] = promised(verdict)
        """Each precision that it can promise of a pose, with the doubt to reject each of BELIEFS
        from."""
        self.k = description.k

    @classmethod
    def open(cls, path: str | Path, threads: int = 1, level: bool = True) -> Self:
        """Read a site file; `threads` is for the network, `level` is whether a level site will do.

        Raises ArtifactError for one that is not whole or of this version, NotInstalledError where a
        package that it needs is missing.
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
                f"{path}: its parts do not fit together ({reason}); pack the site anew"
            ) from None

    @property
    def name(self) -> str:
        """What was packed: STUDY/GRID/MODEL."""
        return self.description.name

    def check(self, promise: float | None) -> None:
        """Raise InputError for a promise that the site cannot make."""
        if promise is not None and promise not in self.promises:
            promises = " and ".join(map(str, self.promises))
            possible = (
                f"it can {promises}: say --promise {min(self.promises)}, or promise= of that"
                if promises
                else "nor any other; ask for none"
            )
            raise InputError(f"promise={promise:g}: this site cannot promise that, {possible}")

    def localize(self, points_m: NDArray[np.floating], promise: float | None = 0.99) -> Fix:
        """Localise a scan's points (n, 3) in metres: x forward, y left, z up, ground at z = 0.

        Points that are not finite are dropped. The fix is accepted with a promised precision, one
        of `promises`; None accepts nothing. Raises InputError for points of another shape, or a
        promise that the site cannot make.
        """
        start = time.perf_counter()
        self.check(promise)
        points_m = finite(points_m)
        if len(points_m) >= SWEEP_POINTS and is_level([points_m]):
            raise InputError(
                "a level sweep, all in one plane: this site is of 3-D scans; `yearloc pack` makes "
                "a level site of a data set of level sweeps, or of a Nav2 map"
            )
        ranking = self.rank(points_m)
        registered = self.register(points_m, Answers.of(ranking))
        return replace(self.judge(registered, promise), ms=1e3 * (time.perf_counter() - start))

    def rank(self, points_m: NDArray[np.float64]) -> Ranking:
        """The method's own ranking of places for one scan (n, 3), in one row."""
        return self.localizer(
            Rows(self.view(points_m)[None], np.zeros(1, np.int64), np.eye(4)[None]), self.k
        )

    def register(self, points_m: NDArray[np.float64], answers: Answers) -> Registered:
        """Register a scan's finite points (n, 3) at a ranking's answers, then all over the map."""
        return self.fixer.fix(points_m, self.targets, answers)

    def judge(self, registered: Registered, promise: float | None) -> Fix:
        """The fix of a scan's hypotheses, with the verdict that a promise allows."""
        if not registered.hypotheses:
            nowhere = np.full((4, 4), np.nan)
            return Fix(
                "no pose",
                -1,
                nowhere,
                registered.alignment.covariance,
                0.0,
                1.0,
                1.0,
                None,
                (),
                0.0,
            )
        best = registered.hypotheses[0]
        doubts = self.judged.doubts(registered).astype(np.float32).astype(np.float64)
        verdict, promised_precision = self.believed(doubts, promise)
        runner_up_pairs = [
            (registered.hypotheses[i], registered.chances[i])
            for i in registered.elsewhere[:RUNNERS_UP]
        ]
        return Fix(
            verdict,
            self._place(best),
            best.world_T_query,
            best.alignment.covariance,
            best.alignment.overlap,
            float(doubts[0]),
            float(doubts[1]),
            promised_precision,
            tuple(
                RunnerUp(
                    self._place(hypothesis),
                    hypothesis.world_T_query,
                    hypothesis.alignment.overlap,
                    chance,
                )
                for hypothesis, chance in runner_up_pairs
            ),
            0.0,
        )

    def believed(
        self, doubts: NDArray[np.float64], promise: float | None
    ) -> tuple[Word, float | None]:
        """The verdict that a promise allows on the doubts (belief,) of a fix with a pose.

        And the highest promise that its pose keeps, None of none.
        """
        limits = NO_LIMITS if promise is None else self.promises.get(promise, NO_LIMITS)
        words = [
            word for word, doubt, limit in zip(WORDS, doubts, limits, strict=True) if doubt < limit
        ]
        kept_promises = [
            precision
            for precision, (reject_from, *_) in self.promises.items()
            if doubts[0] < reject_from
        ]
        return words[0] if words else "rejected", max(kept_promises, default=None)

    def _place(self, hypothesis: Hypothesis) -> int:
        return int(self.places.at(hypothesis.world_T_query[None, :2, 3])[0])


def promised(verdict: Promises) -> dict[float, tuple[float, ...]]:
    """Each precision that a site can promise of a pose, with the doubts to reject BELIEFS from."""
    limits = zip(*(verdict.promised[belief] for belief in BELIEFS), strict=True)
    return {
        promise: reject_from
        for promise, reject_from in zip(verdict.promises, limits, strict=True)
        if promise in verdict.kept
    }


def finite(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The points (n, 3) that are finite.

    Raises InputError for anything of another shape or type.
    """
    points_m = np.asarray(points_m)
    if points_m.ndim != 2 or points_m.shape[1] != 3 or points_m.dtype.kind not in "fiu":
        raise InputError(
            f"points of shape {points_m.shape} and type {points_m.dtype}: expected numbers (n, 3), "
            "in metres"
        )
    points_m = points_m.astype(np.float64)
    return np.asarray(points_m[(np.abs(points_m) < FARTHEST_M).all(axis=1)])
