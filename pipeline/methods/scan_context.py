"""Scan Context-50: the nearest of the 50 whose rings look alike, at its best heading (Kim and Kim, IROS 2018; METHODS 1.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.matching.database import Database
from pipeline.matching.nearest import nearest
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.shifts import ShiftMethod, Spectra
from pipeline.running.progress import Progress
from pipeline.running.settings import positive


@dataclass(frozen=True)
class ScanContext50(ShiftMethod):
    """The authors' place recognition; nothing is trained."""

    view: str = "scan_context"
    candidates: int = 50
    """Nearest ring keys that are compared at every shift."""
    least_engaged: float = 0.0
    """See `ShiftMethod`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("method", candidates=self.candidates)

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Keep the training sequence's ring keys and spectra."""
        heights_m, database = np.asarray(views.images[:]), Database.learned(views, places)
        spectra, keys = Spectra.learned(heights_m, self.least_engaged), ring_keys(heights_m)

        def search(queries: NDArray[np.int64], allowed: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
            distances, found = np.empty(len(queries)), np.empty(len(queries), np.int64)
            for i, row in enumerate(queries):
                rows = np.flatnonzero(allowed[i])
                rows = rows[nearest(keys[rows], keys[[row]], self.candidates)[1][0]]
                compared, _ = spectra.compare(heights_m[row], rows)
                distances[i], found[i] = compared.min(), rows[compared.argmin()]
            return distances, found

        evidence = database.evidence(search, views, self)
        return {"ring_keys": keys, **spectra.arrays(), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The k nearest of the candidates; cost = distance in [0, 2]."""
        spectra, database, keys = Spectra.of(model, self.least_engaged), Database.of(model), model["ring_keys"]

        def localize(views: Rows, k: int) -> Ranking:
            heights_m = spectra.images(views)
            _, rows = nearest(keys, ring_keys(heights_m), self.candidates)
            return spectra.rank(database, heights_m, rows, k, self.distinct_places)

        return localize


def ring_keys(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """How many bins of each ring hold something (n, ring), of Scan Contexts (n, ring, sector); the same at every heading.

    The authors' L0 ratio times the number of sectors: the neighbours are the same, and distances of whole numbers are exact.
    """
    keys: NDArray[np.float32] = np.count_nonzero(heights_m, axis=2).astype(np.float32)
    return keys
