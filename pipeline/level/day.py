"""A training day of level sweeps: its map, its verdict, and what both say of a query."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Scans
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.held_out import LevelHeldOut, Sweeps
from pipeline.level.level_map import Drawing, LevelMap
from pipeline.level.sweeps import OVER_M, Gathered
from pipeline.level.verdict import LARGEST_DOUBT, LevelVerdict
from pipeline.posing.answers import PosedQuery
from pipeline.posing.verdict import BELIEFS


@dataclass(frozen=True)
class LevelDay:
    """What is known of a building after the training day."""

    level_map: LevelMap
    verdict: LevelVerdict
    fixer: LevelFixer

    @classmethod
    def learned(cls, sweeps: Sweeps, unseen_share: float, held_out: LevelHeldOut) -> Self:
        """Draw the sweeps into a map, and localise held-out stretches of them."""
        rows = range(len(sweeps.world_T_sweep))
        drawing = Drawing.of([sweeps.points(row) for row in rows], sweeps.world_T_sweep)
        fixer = LevelFixer()
        evidence = held_out.evidence(fixer, sweeps, drawing, OVER_M)
        return cls(drawing.level_map(), LevelVerdict(evidence, unseen_share), fixer)

    @cached_property
    def field(self) -> Field:
        """The map as it is searched."""
        return Field.of(self.level_map)

    def queries(self, scans: Scans, rows: NDArray[np.int64]) -> list[PosedQuery]:
        """What is believed of some scans of a sequence, each gathered with those before it."""
        gathered = Sweeps.of(scans).gathered(rows.tolist(), OVER_M)
        return [self.query(gathered[row]) for row in rows.tolist()]

    def query(self, gathered: Gathered) -> PosedQuery:
        """What is believed of gathered sweeps: nothing of those of a laser mounted otherwise."""
        judge = self.verdict.judge
        fix = self.fixer.fix(self.field, gathered).ordered(judge.pose)
        if not fix.hypotheses:
            no_covariance = np.full((6, 6), np.nan)
            return PosedQuery(
                np.empty((0, 4, 4)), np.empty(0), no_covariance, 0.0, judge.doubts(fix)
            )
        best = fix.hypotheses[0]
        doubts = judge.doubts(fix)
        if (doubts < LARGEST_DOUBT).any() and self.fixer.is_misread(self.field, gathered, fix):
            doubts = np.ones(len(BELIEFS))
        return PosedQuery(
            np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]),
            judge.chances(fix),
            best.pose_covariance,
            best.support.explained,
            doubts,
        )
