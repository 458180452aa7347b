"""Scan Context against every training scan at every heading: what ring keys may miss (Kim and Kim, IROS 2018; METHODS 1.3)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.matching.database import Database
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.shifts import ShiftMethod, Spectra
from pipeline.running.progress import Progress


@dataclass(frozen=True)
class ScanContextAll(ShiftMethod):
    """The exhaustive search; nothing is trained."""

    view: str = "scan_context"
    least_engaged: float = 0.0
    """See `ShiftMethod`."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Keep the training sequence's spectra."""
        heights_m, database = np.asarray(views.images[:]), Database.learned(views, places)
        spectra, everything = Spectra.learned(heights_m, self.least_engaged), np.arange(len(heights_m))

        @cache
        def distances(row: int) -> NDArray[np.float64]:
            return spectra.compare(heights_m[row], everything)[0]

        def search(queries: NDArray[np.int64], allowed: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
            found = [int(np.where(mask, distances(row), np.inf).argmin()) for row, mask in zip(queries, allowed, strict=True)]
            return np.array([distances(row)[nearest] for row, nearest in zip(queries, found, strict=True)]), np.array(found)

        evidence = database.evidence(search, views, self)
        return {**spectra.arrays(), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The k nearest; cost = distance in [0, 2]."""
        spectra, database = Spectra.of(model, self.least_engaged), Database.of(model)

        def localize(views: Rows, k: int) -> Ranking:
            heights_m = spectra.images(views)
            rows = np.broadcast_to(np.arange(len(database.places)), (len(heights_m), len(database.places)))
            return spectra.rank(database, heights_m, rows, k, self.distinct_places)

        return localize
