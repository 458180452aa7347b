"""Queries: finds the poses of a test sequence's submaps, for the stage `poses` (METHODS 9.4).

In: the scans and submaps of the sequence, one or more rankings of candidate places for each submap,
and a map. Out: a `ScanFix` for each query in each case: unperturbed, then perturbed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.store import A
from pipeline.mapping.gathering import submap_points
from pipeline.perturbations import Case, Perturbation, generator, read_cases
from pipeline.posing.cut_outs import read_targets
from pipeline.posing.fix import ScanFix
from pipeline.posing.registration import Points
from pipeline.posing.search import Answers, Fixer


class Candidates(NamedTuple):
    """The candidate places of each query."""

    xy_m: NDArray[np.float64]
    """(query, candidate, 2) positions; NaN for an answer without a position."""
    heading_deg: NDArray[np.float64]
    """(query, candidate) heading of the query if it is at this place; NaN if it is unknown."""


@dataclass(frozen=True)
class Queries:
    """The queries of one test sequence, whose artifacts lie in these folders."""

    sequence: str
    scans: str
    submaps: str
    rankings: Sequence[str]
    """The folder of the method's own ranking, then of other methods' rankings, whose places are
    candidates too."""
    perturbations: Sequence[Perturbation] = ()
    """The perturbations that made the perturbed cases of the rankings."""

    def fixes(self, fixer: Fixer, map_path: Path, k: int) -> list[ScanFix]:
        """Fix each query in each case of the rankings, case by case.

        The candidates are the first `k` places of each ranking. Raises InputError for a ranking
        that has not these submaps in these cases, and for a case that no perturbation makes.
        """
        targets = read_targets(map_path)
        scans = self._read(self.scans, schemas.Scans)
        submaps = self._read(self.submaps, schemas.Submaps)
        stamps_ns = submaps.load("stamps_ns")
        cases = read_cases(self._read(self.rankings[0], schemas.Rankings).cases)
        row_count = len(stamps_ns)
        candidates = self._candidates(row_count * len(cases), k)
        fixes: list[list[ScanFix]] = [[] for _ in cases]  # by case, then by row
        # Each submap's points are read once, for all cases.
        for row, points_m in enumerate(submap_points(scans, submaps, slice(0, row_count))):
            for i, case in enumerate(cases):
                query = i * row_count + row
                answers = Answers(candidates.xy_m[query], candidates.heading_deg[query])
                perturbed_m = self._perturbed(points_m, case, stamps_ns[row])
                fixes[i].append(fixer.fix(perturbed_m, targets, answers))
        return [fix for fixes_of_case in fixes for fix in fixes_of_case]

    def _perturbed(self, points_m: Points, case: Case, stamp_ns: int) -> Points:
        """The points (n, 3) of a query, perturbed as its case says."""
        if case == Case():
            return points_m
        for perturbation in self.perturbations:
            if case in perturbation.cases:
                perturbed_m, _ = perturbation.perturb(
                    case, points_m, generator(perturbation, stamp_ns)
                )
                return np.asarray(perturbed_m)
        raise InputError(
            f"{self.rankings[0]}: a ranking of {case}, which no perturbation given here makes"
        )

    def _candidates(self, count: int, k: int) -> Candidates:
        """The candidates of all queries (`count`), in all cases.

        The first place of each ranking comes first, then the second of each, and so on.
        """
        positions_m = []
        headings_deg = []
        for folder in self.rankings:
            ranking = self._read(folder, schemas.Rankings)
            xy_m = ranking.load("xy_m")
            if len(xy_m) != count:
                raise InputError(
                    f"{folder}: a ranking of {len(xy_m)} queries; the submaps make {count} in all "
                    "cases"
                )
            positions_m.append(xy_m[:, :k].astype(np.float64))
            headings_deg.append(ranking.load("heading_deg")[:, :k].astype(np.float64))
        return Candidates(
            np.stack(positions_m, axis=2).reshape(count, -1, 2),
            np.stack(headings_deg, axis=2).reshape(count, -1),
        )

    def _read(self, folder: str, kind: type[A]) -> A:
        """Read the sequence's artifact in a folder."""
        return store.read(Path(folder, f"{self.sequence}.zarr"), kind)
