"""Temperature and evidence of a network on held-out views (METHODS 2.6)."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.progress import Progress
from pipeline.matching.rejection import Evidence, is_near
from pipeline.matching.temperature import determined, temperature

Novelties = Callable[
    [NDArray[np.float64], float, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]
]


class Prediction(NamedTuple):
    """A network's outputs for n images."""

    logits: Tensor
    """(n, places)."""
    features: Tensor
    """(n, 64) inputs of the last layer, brought to length 1."""
    heading_deg: Tensor
    """(n, places) if that is the place; NaN where the network has no heading."""

    @property
    def scores(self) -> NDArray[np.float64]:
        """The logits (n, places)."""
        return self.logits.numpy().astype(np.float64)


class KnownViews(NamedTuple):
    """Views of the training sequence, each with its place."""

    seen: Tensor
    """(n, rings, sectors) quantized heights, or (n, 64) features."""
    places: NDArray[np.int64]
    xy_m: NDArray[np.float64]
    """(n, 2)."""

    def some(self, rows: NDArray[np.bool_] | Tensor) -> "KnownViews":
        """Those of a mask or of row numbers."""
        return KnownViews(self.seen[rows], self.places[rows], self.xy_m[rows])


def judge_held_out(
    predict: Callable[[Tensor, Tensor | None], Prediction],
    novelties: Novelties,
    held_out: KnownViews,
    block: NDArray[np.int64],
    place_xy_m: NDArray[np.float64],
    memory: KnownViews,
    neighbour_m: float,
    progress: Progress,
    fallback: float | None = None,
) -> tuple[float, Evidence]:
    """The temperature, and the evidence of held-out views with and without their surroundings.

    Without: the places and training views near them are forgotten. `block` (h,) is the held-out
    block of each. Where the views fix no temperature, it is the `fallback`.
    """
    heights, places, xy_m = held_out
    seen = predict(heights, None)
    unseen = predict(heights, torch.from_numpy(is_near(xy_m, place_xy_m, neighbour_m)))
    softness = temperature(seen.scores, places)
    if fallback is not None and not determined(softness, seen.scores, places):
        softness = fallback
    elif not determined(softness, seen.scores, places):
        line = f"the {len(places)} held-out views fix no temperature, {softness:.3g} is used"
        progress.tell(f"{line}: confidence and tempered_entropy are not calibrated")
    seen_cosines, unseen_cosines = (
        (prediction.features.numpy() @ memory.seen.numpy().T).astype(np.float64)
        for prediction in (seen, unseen)
    )
    unseen_cosines[is_near(xy_m, memory.xy_m, neighbour_m)] = -1
    return softness, Evidence(
        seen.scores.argmax(axis=1) == places,
        novelties(seen.scores, softness, seen_cosines.max(axis=1)),
        novelties(unseen.scores, softness, unseen_cosines.max(axis=1)),
        block,
    )
