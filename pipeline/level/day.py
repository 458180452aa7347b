"""A training day of level sweeps: its map, its verdict, and the poses of later queries on it.

The stage `poses` learns a `LevelDay` from the training sequence, and queries it for the poses of
all test sequences (METHODS 13.5).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Scans
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing, LevelMap
from pipeline.level.sweeps import OVER_M, Gathered
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.level.verdict import LARGEST_ERROR_PROBABILITY, USUAL, verdict_of
from pipeline.posing.answers import PosedQuery
from pipeline.posing.learned_verdict import Learned, basis
from pipeline.posing.verdict import CLAIMS, Verdict


@dataclass(frozen=True)
class LevelDay:
    """The map of a building after its training day, and the verdict on fixes in this map."""

    level_map: LevelMap
    learned: Learned
    fixer: LevelFixer

    @classmethod
    def of(
        cls,
        sweeps: Sweeps,
        unseen_share: float,
        validation: LevelValidation,
        learned: Learned | None = None,
    ) -> Self:
        """Draw the sweeps into a map, and test the verdict on validation stretches of them.

        `unseen_share` is the expected share of queries from places that the map lacks. With a
        verdict `learned` before, no stretches are kept for validation.
        """
        rows = range(len(sweeps.world_T_sweep))
        drawing = Drawing.of([sweeps.points(row) for row in rows], sweeps.world_T_sweep)
        fixer = LevelFixer()
        if learned is None:
            evidence = validation.evidence(fixer, sweeps, drawing, OVER_M)
            learned = Learned.of(evidence, verdict_of(evidence, unseen_share))
        return cls(drawing.level_map(), learned, fixer)

    @property
    def verdict(self) -> Verdict:
        """The verdict on fixes in the map."""
        return self.learned.verdict

    @cached_property
    def field(self) -> Field:
        """The map, prepared for the search."""
        return Field.of(self.level_map)

    def queries(self, scans: Scans, rows: NDArray[np.int64]) -> list[PosedQuery]:
        """The poses of the scans `rows` (n,), each gathered with the scans before it."""
        gathered = Sweeps.of(scans).gathered(rows.tolist(), OVER_M)
        return [self.query(gathered[row]) for row in rows.tolist()]

    def query(self, gathered: Gathered) -> PosedQuery:
        """The poses of gathered sweeps, their probabilities, and the error probability of each
        claim.

        All error probabilities are 1 if the laser seems to be mounted otherwise than specified.
        """
        fix = self.fixer.fix(self.field, gathered).ordered(USUAL.pose)
        query = PosedQuery.of(fix, USUAL)
        may_be_accepted = (
            fix.hypotheses and (query.error_probabilities < LARGEST_ERROR_PROBABILITY).any()
        )
        if may_be_accepted and self.fixer.is_misread(self.field, gathered, fix):
            return replace(query, error_probabilities=np.ones(len(CLAIMS)))
        return query


def sweeps_basis(sweeps: Sweeps, unseen_share: float) -> str:
    """The basis of a day's verdict on level sweeps (`basis` of posing/learned_verdict.py)."""
    return basis(sweeps.world_T_sweep.tobytes(), unseen_share=unseen_share)
