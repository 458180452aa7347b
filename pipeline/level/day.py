"""A training day of level sweeps: its map and its verdict, and what these say of later queries.

The stage `poses` learns a `LevelDay` of the training sequence, and asks it for the poses of all
test sequences (METHODS 13.5).
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
    """What is known of a building after the training day."""

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

        `unseen_share` is the share of queries to expect from places that the map does not have.
        Where a verdict was `learned` before, nothing is kept for validation.
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
        """The verdict on its fixes."""
        return self.learned.verdict

    @cached_property
    def field(self) -> Field:
        """The map, prepared for the search."""
        return Field.of(self.level_map)

    def queries(self, scans: Scans, rows: NDArray[np.int64]) -> list[PosedQuery]:
        """What is accepted of the scans `rows` (n,), each gathered with those before it."""
        gathered = Sweeps.of(scans).gathered(rows.tolist(), OVER_M)
        return [self.query(gathered[row]) for row in rows.tolist()]

    def query(self, gathered: Gathered) -> PosedQuery:
        """The poses of gathered sweeps, their probabilities, and the error probability in each
        claim.

        All error probabilities are 1 where the laser seems to be mounted otherwise than was said.
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
    """What the verdict of a day of sweeps is learned with (posing/learned_verdict.py)."""
    return basis(sweeps.world_T_sweep.tobytes(), unseen_share=unseen_share)
