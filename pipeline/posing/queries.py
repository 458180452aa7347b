"""Queries: the points of a test sequence's submaps, and the candidate places of each.

One or several rankings name the candidates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Alteration, Case, generator, read_cases
from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.store import A
from pipeline.mapping.gathering import submap_points
from pipeline.posing.fix import Fix
from pipeline.posing.registration import Points
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets


@dataclass(frozen=True)
class Queries:
    """The queries of one test sequence, whose artifacts lie in these folders."""

    sequence: str
    scans: str
    submaps: str
    rankings: Sequence[str]
    """The method's own; then others, whose places are candidates too."""
    alterations: Sequence[Alteration] = ()
    """Those that the altered cases of the rankings come from."""

    def fixes(self, fixer: Fixer, map_path: Path, k: int) -> list[Fix]:
        """Fix each query in each case of the rankings, case by case.

        The candidates are the first `k` places of each ranking. Raises InputError where a ranking
        is not of these submaps in these cases, or no alteration has such a case.
        """
        targets = Targets.read(map_path)
        scans = self._read(self.scans, schemas.Scans)
        submaps = self._read(self.submaps, schemas.Submaps)
        stamps_ns = submaps.load("stamps_ns")
        cases = read_cases(self._read(self.rankings[0], schemas.Rankings).cases)
        every_xy_m, every_heading_deg = self._candidates(len(stamps_ns) * len(cases), k)
        xy_m = every_xy_m.reshape(len(cases), len(stamps_ns), -1, 2)
        heading_deg = every_heading_deg.reshape(len(cases), len(stamps_ns), -1)
        fixes_by_case: list[list[Fix]] = [[] for _ in cases]
        for row, points_m in enumerate(submap_points(scans, submaps, slice(0, len(stamps_ns)))):
            for case, fixes, *answers in zip(
                cases, fixes_by_case, xy_m[:, row], heading_deg[:, row], strict=True
            ):
                fixes.append(
                    fixer.fix(
                        self._altered(points_m, case, stamps_ns[row]), targets, Answers(*answers)
                    )
                )
        return [fix for fixes in fixes_by_case for fix in fixes]

    def _altered(self, points_m: Points, case: Case, stamp_ns: int) -> Points:
        """The points (n, 3) of a query, altered as its case says."""
        if case == Case():
            return points_m
        alteration = next(
            (candidate for candidate in self.alterations if case in candidate.cases), None
        )
        if alteration is None:
            raise InputError(
                f"{self.rankings[0]}: a ranking of {case}, which no alteration given here makes"
            )
        return np.asarray(alteration.alter(case, points_m, generator(alteration, stamp_ns))[0])

    def _candidates(self, count: int, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (query, candidate, 2) and headings (query, candidate) of the candidates.

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
        return np.stack(positions_m, axis=2).reshape(count, -1, 2), np.stack(
            headings_deg, axis=2
        ).reshape(count, -1)

    def _read(self, folder: str, kind: type[A]) -> A:
        return store.read(Path(folder, f"{self.sequence}.zarr"), kind)
