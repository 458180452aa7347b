"""Methods that compare Scan Contexts at every shift of their columns (METHODS 1.3 and 1.4).

Kim and Kim, IROS 2018. A shift is a turn of the robot, so the best one gives the heading. A query
is compared with all training views, or with those of the nearest ring keys alone.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.matching.database import Database, DescriptorMethod
from pipeline.matching.nearest import nearest
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.shifts import Spectra


class ShiftMethod(DescriptorMethod):
    """A method that compares Scan Contexts at every shift of their columns; nothing is trained.

    No dataclass itself: each method declares the fields at its own place, for a model's file holds
    them in their order.
    """

    candidates: int | None = None
    """How many training views of the nearest ring keys are compared; None for all."""
    least_engaged: float
    """A shift counts if it engages at least this share of the columns that the pair's fullest shift
    engages. With the authors' 0 a shift at which a single column overlaps can win, as often with a
    sensor that sees half the circle; 0.9 prevents it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.least_engaged <= 1:
            raise ConfigError(
                f"method.least_engaged={self.least_engaged}: expected a share from 0 to 1"
            )

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Keep the training sequence's spectra, and its ring keys where they choose candidates."""
        heights_m = np.asarray(views.images[:])
        database = Database.learned(views, places)
        spectra = Spectra.learned(heights_m, self.least_engaged)
        keys = ring_keys(heights_m)

        def search(
            queries: NDArray[np.int64], allowed: NDArray[np.bool_]
        ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
            distances = np.empty(len(queries))
            nearest_rows = np.empty(len(queries), np.int64)
            for i, query in enumerate(queries):
                rows = np.flatnonzero(allowed[i])
                candidates = rows[self._candidates(keys[rows], keys[[query]])[0]]
                likely_rows = spectra.likely(heights_m[query], candidates, k=1)
                row_distances, _ = spectra.compare(heights_m[query], likely_rows)
                distances[i] = row_distances.min()
                nearest_rows[i] = likely_rows[row_distances.argmin()]
            return distances, nearest_rows

        evidence = database.evidence(search, views, self)
        stored_keys = {} if self.candidates is None else {"ring_keys": keys}
        return {**stored_keys, **spectra.arrays(), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The k nearest of the candidates; cost = distance in [0, 2]."""
        spectra = Spectra.of(model, self.least_engaged)
        database = Database.of(model)
        keys = model.get("ring_keys", np.empty((len(database.places), 0), np.float32))

        def localize(views: Rows, k: int) -> Ranking:
            heights_m = spectra.images(views)
            rows = self._candidates(keys, ring_keys(heights_m))
            return spectra.rank(database, heights_m, rows, k, self.distinct_places)

        return localize

    def _candidates(
        self, keys: NDArray[np.float32], queries: NDArray[np.float32]
    ) -> NDArray[np.int64]:
        """Rows (q, m) of ring keys (n, ring) to compare with those (q, ring) of queries."""
        if self.candidates is None:
            return np.broadcast_to(np.arange(len(keys)), (len(queries), len(keys)))
        return nearest(keys, queries, self.candidates)[1]


def ring_keys(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ring keys (n, ring) of Scan Contexts (n, ring, sector), the same at every heading.

    How many bins of a ring hold something. The authors divide that by the number of sectors:
    neighbours are the same, but distances of whole numbers are exact.
    """
    keys: NDArray[np.float32] = np.count_nonzero(heights_m, axis=2).astype(np.float32)
    return keys
