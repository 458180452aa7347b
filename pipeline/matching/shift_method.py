"""Base of the methods that compare Scan Contexts at every shift of their columns (Kim and Kim, IROS
2018; METHODS 1.3 and 1.4).

A shift is a turn of the robot, so the best shift gives the heading. A query is compared with all
training views, or only with the views whose ring keys are nearest to its own. A ring key is a small
descriptor that is the same at every heading.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.core.settings import Share
from pipeline.matching.database import Database, DescriptorMethod
from pipeline.matching.nearest import nearest
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.shifts import Spectra


class ShiftMethod(DescriptorMethod):
    """A method that compares Scan Contexts at every shift of their columns; nothing is trained.

    This class is not a dataclass: the file of a model lists a method's fields in their order, so
    each method declares them itself.
    """

    candidates: int | None = None
    """How many training views, those with the nearest ring keys, are compared; None compares all.
    """
    least_engaged: Share
    """A shift counts if it shares at least this share of the most non-empty columns that any shift
    shares. With the authors' 0, a shift that shares a single column may win, which is frequent with
    a sensor that sees half the circle; 0.9 prevents it."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Store the spectra of training, and its ring keys if they choose candidates."""
        heights_m = np.asarray(views.images[:])
        database = Database.learned(views, places)
        spectra = Spectra.learned(heights_m, self.least_engaged)
        keys = ring_keys(heights_m)

        def search(
            queries: NDArray[np.int64], is_allowed: NDArray[np.bool_]
        ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
            """A `database.Search` among the training views."""
            distances = np.empty(len(queries))
            nearest_rows = np.empty(len(queries), np.int64)
            for i, query in enumerate(queries):
                rows = np.flatnonzero(is_allowed[i])
                (columns,) = self._candidate_rows(keys[rows], keys[[query]])
                candidates = rows[columns]
                likely_rows = spectra.likely(heights_m[query], candidates, k=1)
                row_distances, _ = spectra.compare(heights_m[query], likely_rows)
                distances[i] = row_distances.min()
                nearest_rows[i] = likely_rows[row_distances.argmin()]
            return distances, nearest_rows

        evidence = database.evidence(search, views, self)
        stored_keys = {} if self.candidates is None else {"ring_keys": keys}
        return {**stored_keys, **spectra.arrays(), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """Make the function that ranks the k nearest candidates; costs are distances in [0, 2]."""
        spectra = Spectra.of(model, self.least_engaged)
        database = Database.of(model)
        # Without stored keys all rows are candidates, and only the number of keys is read.
        keys = model.get("ring_keys", np.empty((len(database.places), 0), np.float32))

        def localize(views: Rows, k: int) -> Ranking:
            heights_m = spectra.read_heights(views)
            rows = self._candidate_rows(keys, ring_keys(heights_m))
            return spectra.rank(database, heights_m, rows, k, self.distinct_places)

        return localize

    def _candidate_rows(
        self, keys: NDArray[np.float32], queries: NDArray[np.float32]
    ) -> NDArray[np.int64]:
        """The m training rows (q, m) that each query is compared with, by ring keys (·, ring)."""
        if self.candidates is None:
            return np.broadcast_to(np.arange(len(keys)), (len(queries), len(keys)))
        _, rows = nearest(keys, queries, self.candidates)
        return rows


def ring_keys(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Ring keys (n, ring) of Scan Contexts (n, ring, sector): the non-empty bins of each ring.

    The authors divide it by the number of sectors. That changes no neighbour, but distances between
    whole numbers are exact.
    """
    return np.asarray(np.count_nonzero(heights_m, axis=2).astype(np.float32))
