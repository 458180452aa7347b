"""Calibrates the temperature and collects evidence for the rejection threshold (METHODS 2.6).

In: a network, and views of validation blocks, which are held out from training, though their places
were trained on other views. Out: the temperature at which the network's softmax is calibrated; and
the evidence from which the threshold of rejection is chosen: the novelty of each of these views
twice, as it is, and with all places and training views near it left out.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.progress import Progress
from pipeline.matching.rejection import NoveltyEvidence, is_near
from pipeline.matching.temperature import determines_temperature, fit_temperature

Novelties = Callable[
    [NDArray[np.float64], float, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]
]
"""Computes kinds of novelty from the logits (n, places), the temperature, and the largest cosine
(n,) to a training view (`Classifier.novelties`)."""


class Prediction(NamedTuple):
    """A network's outputs for n images."""

    logits: Tensor
    """(n, places) the logit of each place; −∞ for a place that is left out."""
    features: Tensor
    """(n, 64) inputs of the last layer, scaled to length 1."""
    heading_deg: Tensor
    """(n, places) the heading if the place is right; NaN for a network without headings."""

    @property
    def float64_logits(self) -> NDArray[np.float64]:
        """The logits (n, places) as a numpy array of float64."""
        return self.logits.numpy().astype(np.float64)


class KnownViews(NamedTuple):
    """Views of the training sequence, each with its place."""

    content: Tensor
    """(n, rings, sectors) quantized heights, for views that are given to the network; or (n, 64)
    features of length 1, for training views that queries are compared with."""
    places: NDArray[np.int64]
    """(n,) the place of each view."""
    xy_m: NDArray[np.float64]
    """(n, 2) the position of each view in the world."""

    def select(self, rows: NDArray[np.bool_] | Tensor) -> "KnownViews":
        """The views of some rows, given by a mask (n,) or by row numbers (m,)."""
        return KnownViews(self.content[rows], self.places[rows], self.xy_m[rows])


def calibrate_on_validation(
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
    """The temperature, and the evidence of n validation views.

    Each view is queried twice: as a seen place, and as a novel place, for which the places and
    training views nearer than `neighbour_m` are left out. `predict` takes heights (n, rings,
    sectors) and a mask (n, places) of the places to leave out, or None. `validation` holds heights,
    `memory` the features of the training views, `place_xy_m` (places, 2) the positions of the
    places, `block` (n,) the number of each validation view's block. If the views do not determine a
    temperature, the `fallback` is used; without one, the best temperature found, with a note.
    """
    heights, places, xy_m = validation
    seen = predict(heights, None)
    unseen = predict(heights, torch.from_numpy(is_near(xy_m, place_xy_m, neighbour_m)))

    temperature = fit_temperature(seen.float64_logits, places)
    if not determines_temperature(temperature, seen.float64_logits, places):
        if fallback is not None:
            temperature = fallback
        else:
            progress.tell(
                f"the {len(places)} validation views fix no temperature, {temperature:.3g} is "
                "used: confidence and tempered_entropy are not calibrated"
            )

    memory_features = memory.content.numpy()
    seen_cosines = (seen.features.numpy() @ memory_features.T).astype(np.float64)
    unseen_cosines = (unseen.features.numpy() @ memory_features.T).astype(np.float64)
    # A training view that is left out gets the lowest possible cosine.
    unseen_cosines[is_near(xy_m, memory.xy_m, neighbour_m)] = -1
    return temperature, NoveltyEvidence(
        right=seen.float64_logits.argmax(axis=1) == places,
        seen=novelties(seen.float64_logits, temperature, seen_cosines.max(axis=1)),
        unseen=novelties(unseen.float64_logits, temperature, unseen_cosines.max(axis=1)),
        block=block,
    )
