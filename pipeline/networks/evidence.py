"""Temperature and evidence of a network, from validation views of the training day (METHODS 2.6).

In: a network, and views of validation blocks, which it did not learn but whose places it knows.
Out: the temperature at which its softmax is calibrated; and the evidence from which the threshold
of rejection is chosen: the novelty of these views as they are, and without their surroundings.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.progress import Progress
from pipeline.matching.rejection import NoveltyEvidence, is_near
from pipeline.matching.temperature import determined, temperature

Novelties = Callable[
    [NDArray[np.float64], float, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]
]
"""Computes kinds of novelty from logits, temperature and likeness (`Classifier.novelties`)."""


class Prediction(NamedTuple):
    """A network's outputs for n images."""

    logits: Tensor
    """(n, places) a logit of each place."""
    features: Tensor
    """(n, 64) inputs of the last layer, scaled to length 1."""
    heading_deg: Tensor
    """(n, places) the heading if the place is right; NaN for a network without headings."""

    @property
    def scores(self) -> NDArray[np.float64]:
        """The logits (n, places)."""
        return self.logits.numpy().astype(np.float64)


class KnownViews(NamedTuple):
    """Views of the training sequence, each with its place."""

    content: Tensor
    """(n, rings, sectors) quantized heights of the views, or (n, 64) their features."""
    places: NDArray[np.int64]
    """(n,) the place of each view."""
    xy_m: NDArray[np.float64]
    """(n, 2) the position of each view."""

    def some(self, rows: NDArray[np.bool_] | Tensor) -> "KnownViews":
        """The views of some rows, given by a mask or by their numbers."""
        return KnownViews(self.content[rows], self.places[rows], self.xy_m[rows])


def judge_validation(
    predict: Callable[[Tensor, Tensor | None], Prediction],
    novelties: Novelties,
    validation: KnownViews,
    block: NDArray[np.int64],
    place_xy_m: NDArray[np.float64],
    memory: KnownViews,
    neighbour_m: float,
    progress: Progress,
    fallback: float | None = None,
) -> tuple[float, NoveltyEvidence]:
    """The temperature, and the evidence of h validation views.

    Each view is queried twice: as a seen place, and as a novel place, for which the places and
    training views nearer than `neighbour_m` are left out. `place_xy_m` (place, 2) are the positions
    of the places, `memory` the features of the training views, `block` (h,) the validation block of
    each view. If the views do not determine a temperature, the `fallback` is used.
    """
    heights, places, xy_m = validation
    seen = predict(heights, None)
    unseen = predict(heights, torch.from_numpy(is_near(xy_m, place_xy_m, neighbour_m)))

    softness = temperature(seen.scores, places)
    if not determined(softness, seen.scores, places):
        if fallback is not None:
            softness = fallback
        else:
            progress.tell(
                f"the {len(places)} validation views fix no temperature, {softness:.3g} is used: "
                "confidence and tempered_entropy are not calibrated"
            )

    memory_features = memory.content.numpy()
    seen_cosines = (seen.features.numpy() @ memory_features.T).astype(np.float64)
    unseen_cosines = (unseen.features.numpy() @ memory_features.T).astype(np.float64)
    # A training view that is left out gets the lowest possible cosine.
    unseen_cosines[is_near(xy_m, memory.xy_m, neighbour_m)] = -1
    return softness, NoveltyEvidence(
        right=seen.scores.argmax(axis=1) == places,
        seen=novelties(seen.scores, softness, seen_cosines.max(axis=1)),
        unseen=novelties(unseen.scores, softness, unseen_cosines.max(axis=1)),
        block=block,
    )
