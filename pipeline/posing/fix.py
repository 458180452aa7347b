"""Fixes: the poses that a query may have, likeliest first, with their probabilities (METHODS 9.5).

In: hypotheses, each a pose from one registration with the evidence for and against it. Out: a fix:
of hypotheses at the same pose the best one is kept, and these are ordered by the probability that
they are right. `search` makes hypotheses, `verdict` judges fixes. The fixes of 3-D scans
(`ScanFix`) and of level sweeps (pipeline/level/fix.py) have one base class, `Registered`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn
from pipeline.posing.aliases import Aliases
from pipeline.posing.prior import Prior
from pipeline.posing.probabilities import FEATURES, USUAL, HypothesisModel
from pipeline.posing.registration import Alignment
from pipeline.posing.verification import Agreement

ELSEWHERE_M = 5.0
"""Poses at least this far apart count as different places."""
SAME_M = 2.0
SAME_DEG = 5.0
"""Two hypotheses whose poses differ by less than both of these are at the same pose."""
LEAST_SPREAD_M = 1e-4
MOST_TILT_DEG = 10.0
"""Bounds at which the features `surety` and `upright` are cut off."""


class Possible(Protocol):
    """A pose that a query may have, from a 3-D scan or from level sweeps."""

    @property
    def world_T_query(self) -> NDArray[np.float64]:
        """(4, 4) the pose."""

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """(6, 6) covariance of a small turn in radians, then of a step in metres, in the query's
        frame."""

    @property
    def overlap(self) -> float:
        """The share of the query that lies on the map."""


PossibleT = TypeVar("PossibleT", bound=Possible)


@dataclass(frozen=True)
class Registered(ABC, Generic[PossibleT]):
    """The hypotheses of a query, all at different poses, the likeliest first.

    There is no hypothesis if the query has too few points, or if no registration succeeded.
    """

    hypotheses: tuple[PossibleT, ...] = ()
    probabilities: tuple[float, ...] = ()
    """(n,) the probability that each hypothesis is right. At most one of them is, so the
    probabilities and that of "none is right" add up to 1."""
    prior: Prior | None = None
    """The prior that narrowed the search and weighs the hypotheses; None without one."""

    @property
    def log_weights(self) -> NDArray[np.float64] | None:
        """(n,) the logarithm of each hypothesis's weight by the prior; None without one."""
        return None if self.prior is None else self.prior.log_weights(self.poses)

    @property
    @abstractmethod
    def features(self) -> NDArray[np.float64]:
        """(n, feature) the features of each hypothesis."""

    @property
    @abstractmethod
    def elsewhere(self) -> list[int]:
        """The indices of the runners-up at other places, the likeliest first."""

    @abstractmethod
    def ordered(self, model: HypothesisModel) -> Self:
        """The same hypotheses, with the probabilities of another model and in their order."""

    @property
    def poses(self) -> Poses:
        """(n, 4, 4) the poses of the hypotheses."""
        return _poses(self.hypotheses)

    @property
    def pose(self) -> NDArray[np.float64]:
        """(4, 4) the likeliest pose; NaN without one."""
        return self.hypotheses[0].world_T_query if self.hypotheses else np.full((4, 4), np.nan)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) the covariance of the likeliest pose; infinite without one."""
        return self.hypotheses[0].pose_covariance if self.hypotheses else np.full((6, 6), np.inf)

    @property
    def overlap(self) -> float:
        """The overlap of the likeliest pose; 0 without one."""
        return self.hypotheses[0].overlap if self.hypotheses else 0.0

    @property
    def probability(self) -> float:
        """The probability that the likeliest pose is right; 0 without one."""
        return self.probabilities[0] if self.probabilities else 0.0


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have, with the evidence for and against it."""

    row: int
    """The training submap that the query was registered against."""
    world_T_query: NDArray[np.float64]
    """(4, 4) the pose."""
    alignment: Alignment
    """The alignment with this submap."""
    here: Agreement
    """The agreement with this submap."""
    beside: Agreement
    """The agreement with another submap near the pose; the same as `here` if there is none."""
    tilt_deg: float
    """Angle between the query's and the submap's upward axes."""
    aliases: Aliases
    """The poses elsewhere at which the query's walls fit best, and the margin over them."""
    approach_overlap: float = 1.0
    """The overlap after the rough registration (`Approach`) that this pose was refined from."""
    excess: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(FEATURES)))
    """(feature,) how far the features of right fixes near this pose exceed the day's medians
    (`Expectations.excess`)."""

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """The covariance (6, 6) of the alignment, whose residuals depend on their neighbours'."""
        return self.alignment.dependent_covariance

    @property
    def overlap(self) -> float:
        """The overlap of the alignment."""
        return self.alignment.overlap

    @property
    def quality(self) -> float:
        """The mean of the agreements' products, by which the hypotheses of a query are compared."""
        return (self.here.product + self.beside.product) / 2

    @property
    def features(self) -> NDArray[np.float64]:
        """The features (feature,) in the order of probabilities.FEATURES, minus `excess`.

        The last feature, `ahead`, is 0 here: the function `features` below fills it in, since it
        compares all hypotheses of the query.
        """
        overlap = (self.here.overlap + self.beside.overlap) / 2
        seen_again = (self.here.seen_again + self.beside.seen_again) / 2
        surety = -np.log10(max(self.alignment.spread_m, LEAST_SPREAD_M))
        upright = -min(self.tilt_deg, MOST_TILT_DEG) / MOST_TILT_DEG
        measured = np.array([overlap, seen_again, surety, upright, self.aliases.margin, 0.0])
        return measured - self.excess


@dataclass(frozen=True)
class ScanFix(Registered[Hypothesis]):
    """The hypotheses of a 3-D scan."""

    @classmethod
    def of(
        cls,
        hypotheses: Sequence[Hypothesis],
        model: HypothesisModel = USUAL,
        prior: Prior | None = None,
    ) -> Self:
        """Build a fix from hypotheses in any order, with the probabilities of a model.

        Of the hypotheses at one pose, the one of the highest quality is kept.
        """
        distinct: list[Hypothesis] = []
        for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.quality):
            if not is_same_pose(hypothesis, distinct).any():
                distinct.append(hypothesis)
        probabilities = model.probabilities(
            features(distinct), None if prior is None else prior.log_weights(_poses(distinct))
        )
        order = np.argsort(-probabilities, kind="stable").tolist()
        return cls(
            tuple(distinct[i] for i in order),
            tuple(float(probabilities[i]) for i in order),
            prior,
        )

    def ordered(self, model: HypothesisModel) -> Self:
        """The same hypotheses, with the probabilities of another model and in their order."""
        return self.of(self.hypotheses, model, self.prior)

    @property
    def features(self) -> NDArray[np.float64]:
        """The features (n, feature) of the hypotheses, in the order of probabilities.FEATURES."""
        return features(self.hypotheses)

    @property
    def elsewhere(self) -> list[int]:
        """The indices of the runners-up at other places, the likeliest first.

        Each is at least ELSEWHERE_M from the likeliest hypothesis and from those listed before it.
        """
        chosen: list[int] = []
        chosen_xy_m = np.empty((0, 2))
        for i, hypothesis in enumerate(self.hypotheses):
            xy_m = hypothesis.world_T_query[:2, 3]
            if (np.linalg.norm(chosen_xy_m - xy_m, axis=1) >= ELSEWHERE_M).all():
                chosen.append(i)
                chosen_xy_m = np.vstack([chosen_xy_m, xy_m])
        return chosen[1:]


def features(hypotheses: Sequence[Hypothesis]) -> NDArray[np.float64]:
    """The features (n, feature) of a query's hypotheses, in the order of probabilities.FEATURES."""
    feature_rows = np.array([hypothesis.features for hypothesis in hypotheses]).reshape(
        -1, len(FEATURES)
    )
    quality = np.array([hypothesis.quality for hypothesis in hypotheses])
    if len(quality) > 1:  # a single hypothesis has no runner-up
        is_itself = np.eye(len(quality), dtype=bool)
        other_qualities = np.where(is_itself, -np.inf, quality)
        # The last feature is `ahead`.
        feature_rows[:, -1] = quality - other_qualities.max(axis=1)
    return feature_rows


def is_same_pose(hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> NDArray[np.bool_]:
    """Which of n other hypotheses (n,) are at the same pose, within SAME_M and SAME_DEG."""
    world_T_query = np.broadcast_to(hypothesis.world_T_query, (len(others), 4, 4))
    away_m, turn_deg = distance_and_turn(_poses(others), world_T_query)
    return np.asarray((away_m < SAME_M) & (turn_deg < SAME_DEG))


def _poses(hypotheses: Sequence[Possible]) -> Poses:
    """The poses (n, 4, 4) of n hypotheses."""
    return np.array([hypothesis.world_T_query for hypothesis in hypotheses]).reshape(-1, 4, 4)
