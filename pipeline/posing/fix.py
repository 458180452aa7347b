"""Fixes: the poses that a query may have, likeliest first, with their chances (METHODS 9.5)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn
from pipeline.posing.chances import SIGNS, USUAL, Chances
from pipeline.posing.registration import NOWHERE, Alignment
from pipeline.posing.slides import Slide
from pipeline.posing.verification import Agreement

ELSEWHERE_M = 5.0
"""Hypotheses this far apart contradict one another."""
SAME_M = 2.0
SAME_DEG = 5.0
"""Within these two hypotheses are one."""
LEAST_SPREAD_M = 1e-4
MOST_TILT_DEG = 10.0


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    row: int
    """The training submap that it was registered against."""
    world_T_query: NDArray[np.float64]
    """(4, 4)."""
    alignment: Alignment
    """The alignment with that submap."""
    here: Agreement
    """The agreement with that submap."""
    beside: Agreement
    """The agreement with another submap near the pose, against which it was not registered; where
    there is none, `here`."""
    tilt_deg: float
    """Angle between the query's and the submap's upward axes."""
    slide: Slide
    """Where else along its street the walls fit best."""
    approached: float = 1.0
    """The overlap of the approach that it was refined from."""
    excess: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(SIGNS)))
    """By how much the signs (sign,) of right fixes around it exceed the usual (Expectations)."""

    @property
    def quality(self) -> float:
        """The mean product of both agreements, by which hypotheses of one query are compared."""
        return (self.here.product + self.beside.product) / 2

    @property
    def signs(self) -> NDArray[np.float64]:
        """The signs (sign,) in the order of chances.SIGNS, less what is expected there.

        The last is left at 0, as it takes all hypotheses of the query.
        """
        overlap = (self.here.overlap + self.beside.overlap) / 2
        seen_again = (self.here.seen_again + self.beside.seen_again) / 2
        surety = -np.log10(max(self.alignment.spread_m, LEAST_SPREAD_M))
        upright = -min(self.tilt_deg, MOST_TILT_DEG) / MOST_TILT_DEG
        measured = np.array([overlap, seen_again, surety, upright, self.slide.lead, 0.0])
        return measured - self.excess


@dataclass(frozen=True)
class Fix:
    """The hypotheses of a query, which contradict one another, the likeliest first.

    There are none where too few points tell.
    """

    hypotheses: tuple[Hypothesis, ...] = ()
    chances: tuple[float, ...] = ()
    """The chance that each is right; what lacks of 1 is the chance that none is."""

    @classmethod
    def of(cls, hypotheses: Sequence[Hypothesis], chances: Chances = USUAL) -> Self:
        """Build a fix from hypotheses in any order.

        Of those within 2 m and 5° of one another the one of the highest quality stays.
        """
        kept: list[Hypothesis] = []
        for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.quality):
            if not same(hypothesis, kept).any():
                kept.append(hypothesis)
        shares = chances.of(signs(kept))
        order = np.argsort(-shares, kind="stable").tolist()
        return cls(tuple(kept[i] for i in order), tuple(float(shares[i]) for i in order))

    @property
    def alignment(self) -> Alignment:
        """The alignment of the best hypothesis; NOWHERE without one."""
        return self.hypotheses[0].alignment if self.hypotheses else NOWHERE

    @property
    def chance(self) -> float:
        """The chance that the best hypothesis is right; 0 without one."""
        return self.chances[0] if self.chances else 0.0

    @property
    def elsewhere(self) -> list[int]:
        """The numbers of the hypotheses, without the best, that stand apart from all before them.

        They stand ELSEWHERE_M or more from each of these.
        """
        kept: list[int] = []
        for number, hypothesis in enumerate(self.hypotheses):
            kept_m = np.array([self.hypotheses[i].world_T_query[:2, 3] for i in kept]).reshape(
                -1, 2
            )
            if (
                np.linalg.norm(kept_m - hypothesis.world_T_query[:2, 3], axis=1) >= ELSEWHERE_M
            ).all():
                kept.append(number)
        return kept[1:]


def signs(hypotheses: Sequence[Hypothesis]) -> NDArray[np.float64]:
    """The signs (n, sign) of a query's hypotheses, in the order of chances.SIGNS."""
    sign_rows = np.array([hypothesis.signs for hypothesis in hypotheses]).reshape(
        len(hypotheses), len(SIGNS)
    )
    quality = np.array([hypothesis.quality for hypothesis in hypotheses])
    if len(quality) > 1:  # one alone is ahead of nothing
        other_qualities = np.where(np.eye(len(quality), dtype=bool), -np.inf, quality)
        sign_rows[:, -1] = quality - other_qualities.max(axis=1)
    return sign_rows


def same(hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> NDArray[np.bool_]:
    """Which of n others (n,) have the pose of a hypothesis, within SAME_M and SAME_DEG."""
    world_T_query = np.broadcast_to(hypothesis.world_T_query, (len(others), 4, 4))
    away_m, turn_deg = distance_and_turn(_poses(others), world_T_query)
    return np.asarray((away_m < SAME_M) & (turn_deg < SAME_DEG))


def poses(fixes: Sequence[Fix]) -> Poses:
    """The poses (q, 4, 4) of the best hypotheses; NaN without one."""
    no_pose = np.full((4, 4), np.nan)
    return np.array(
        [fix.hypotheses[0].world_T_query if fix.hypotheses else no_pose for fix in fixes]
    ).reshape(-1, 4, 4)


def _poses(hypotheses: Sequence[Hypothesis]) -> Poses:
    return np.array([hypothesis.world_T_query for hypothesis in hypotheses]).reshape(-1, 4, 4)
