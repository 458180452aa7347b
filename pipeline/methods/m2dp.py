"""M2DP: the nearest training signature by Euclidean distance; nothing is trained (He, Wang and
Zhang, IROS 2016; METHODS 3.1).

A signature is a vector that describes a submap; the view `m2dp` computes it. `learn` stores the
signatures of the training sequence, and `localizer` ranks them by their distance from the query's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.database import Database, DescriptorMethod, euclidean
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows


@dataclass(frozen=True)
class M2dp(DescriptorMethod):
    """M2DP, without settings of its own."""

    view: str = "m2dp"

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Store the training sequence's signatures (n, d).

        Raises InputError unless each view has a place.
        """
        database = Database.learned(views, places)
        signatures = _signatures(views)
        evidence = database.evidence(euclidean(signatures), views, self)
        return {"signatures": signatures, **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """Rank training signatures; cost and novelty are the distance.

        The distance is at most 2, since each half of a signature has length 1 and no negative
        number.
        """
        database = Database.of(model)
        signatures = model["signatures"]

        def localize(views: Rows, k: int) -> Ranking:
            return database.nearest(signatures, _signatures(views), k, self.distinct_places)

        return localize


def _signatures(views: Rows) -> NDArray[np.float32]:
    """All signatures (n, d) of a view."""
    signatures = np.ascontiguousarray(views.images[:], np.float32)
    if signatures.ndim != 2:
        raise InputError(f"views of shape {signatures.shape}: expected signatures (n, d)")
    return signatures
