"""Queries: the points of a test sequence's submaps, and the candidate places that one or several rankings name for each."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.errors import InputError
from pipeline.mapping.gathering import submap_points
from pipeline.posing.fix import Fix, Fixer
from pipeline.posing.targets import Targets
from pipeline.store import Artifact, Schema


@dataclass(frozen=True)
class Queries:
    """The queries of one test sequence, whose artifacts lie in these folders."""

    sequence: str
    scans: str
    submaps: str
    rankings: Sequence[str]
    """The method's own; then others, whose places are candidates too."""

    def fixes(self, fixer: Fixer, map_path: Path, k: int) -> list[Fix]:
        """A fix of each query as driven, from the first `k` places of each ranking.

        Raises InputError where a ranking is not of these submaps.
        """
        targets = Targets(map_path)
        scans, submaps = self._read(self.scans, schemas.SCANS), self._read(self.submaps, schemas.SUBMAPS)
        count = submaps["scans"].shape[0]
        points = submap_points(scans, submaps, slice(0, count))
        answers = zip(points, self._candidates_m(count, k), strict=True)
        return [fixer.fix(points_m, targets, xy_m) for points_m, xy_m in answers]

    def _candidates_m(self, count: int, k: int) -> NDArray[np.float64]:
        """Positions (query, candidate, 2): the first place of each ranking, then the second of each, and so on."""
        every = []
        for folder in self.rankings:
            xy_m = self._read(folder, schemas.RANKINGS).load("xy_m")
            if len(xy_m) < count:
                raise InputError(f"{folder}: a ranking of {len(xy_m)} queries for {count} submaps")
            every.append(xy_m[:count, :k])
        return np.stack(every, axis=2).reshape(count, -1, 2)

    def _read(self, folder: str, schema: Schema) -> Artifact:
        return store.read(Path(folder, f"{self.sequence}.zarr"), schema)
