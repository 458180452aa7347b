"""Fixes: the poses that a query may have, the likeliest first, with the chance of each (METHODS
9.5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, apart
from pipeline.posing.chances import SIGNS, USUAL, Chances
from pipeline.posing.registration import NOWHERE, Alignment
from pipeline.posing.slides import Slide
from pipeline.posing.verification import Agreement

ELSEWHERE_M = 5.0
"""So far apart two hypotheses contradict one another."""
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
    """With that submap."""
    here: Agreement
    """With that submap."""
    beside: Agreement
    """With another one near the pose, against which it was not registered; where there is none,
    `here`."""
    tilt_deg: float
    """Between the query's and the submap's upward axes."""
    slide: Slide
    """Where else along its street the walls fit best."""

    @property
    def quality(self) -> float:
        """By which hypotheses of one query are compared: the mean product of both agreements."""
        return (self.here.product + self.beside.product) / 2

    @property
    def signs(self) -> NDArray[np.float64]:
        """(sign,) as chances.SIGNS has them, but for the last, which takes all hypotheses of the
        query."""
        overlap = (self.here.overlap + self.beside.overlap) / 2
        seen_again = (self.here.seen_again + self.beside.seen_again) / 2
        surety = -np.log10(max(self.alignment.spread_m, LEAST_SPREAD_M))
        upright = -min(self.tilt_deg, MOST_TILT_DEG) / MOST_TILT_DEG
        return np.array([overlap, seen_again, surety, upright, self.slide.lead, 0.0])


@dataclass(frozen=True)
class Fix:
    """All hypotheses of a query that contradict one another, the likeliest first; none where too
    few points tell."""

    hypotheses: tuple[Hypothesis, ...] = ()
    chances: tuple[float, ...] = ()
    """That each is right; what lacks of 1 is that none is."""

    @classmethod
    def of(cls, found: Sequence[Hypothesis], chances: Chances = USUAL) -> Self:
        """Of hypotheses in any order; of those within 2 m and 5° of one another the best stays.

        The best has the highest quality.
        """
        kept: list[Hypothesis] = []
        for one in sorted(found, key=lambda one: -one.quality):
            away_m, turn_deg = apart(
                _poses(kept), np.broadcast_to(one.world_T_query, (len(kept), 4, 4))
            )
            if not ((away_m < SAME_M) & (turn_deg < SAME_DEG)).any():
                kept.append(one)
        shares = chances.of(signs(kept))
        order = np.argsort(-shares, kind="stable").tolist()
        return cls(tuple(kept[i] for i in order), tuple(float(shares[i]) for i in order))

    @property
    def alignment(self) -> Alignment:
        """Of the best hypothesis; NOWHERE without one."""
        return self.hypotheses[0].alignment if self.hypotheses else NOWHERE

    @property
    def chance(self) -> float:
        """That the best hypothesis is right; 0 without one."""
        return self.chances[0] if self.chances else 0.0

    @property
    def elsewhere(self) -> list[int]:
        """The numbers of the hypotheses that stand ELSEWHERE_M or more from each one before them,
        without the best."""
        kept: list[int] = []
        for number, one in enumerate(self.hypotheses):
            others_m = np.array([self.hypotheses[i].world_T_query[:2, 3] for i in kept]).reshape(
                -1, 2
            )
            if (np.linalg.norm(others_m - one.world_T_query[:2, 3], axis=1) >= ELSEWHERE_M).all():
                kept.append(number)
        return kept[1:]


def signs(hypotheses: Sequence[Hypothesis]) -> NDArray[np.float64]:
    """What speaks for each of a query's hypotheses, (n, sign) as chances.SIGNS has it."""
    found = np.array([one.signs for one in hypotheses]).reshape(len(hypotheses), len(SIGNS))
    quality = np.array([one.quality for one in hypotheses])
    if len(quality) > 1:  # one alone is ahead of nothing
        others = np.where(np.eye(len(quality), dtype=bool), -np.inf, quality)
        found[:, -1] = quality - others.max(axis=1)
    return found


def poses(fixes: Sequence[Fix]) -> Poses:
    """(q, 4, 4) of the best hypotheses; NaN without one."""
    none = np.full((4, 4), np.nan)
    return np.array(
        [fix.hypotheses[0].world_T_query if fix.hypotheses else none for fix in fixes]
    ).reshape(-1, 4, 4)


def _poses(hypotheses: Sequence[Hypothesis]) -> Poses:
    return np.array([one.world_T_query for one in hypotheses]).reshape(-1, 4, 4)
