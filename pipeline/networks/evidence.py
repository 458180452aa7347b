"""What held-out views say of a network: its temperature, and the evidence that thresholds are
chosen from (METHODS 2.6)."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.matching.rejection import Evidence, near
from pipeline.matching.temperature import determined, temperature
from pipeline.running.progress import Progress

Novelties = Callable[
    [NDArray[np.float64], float, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]
]


class Prediction(NamedTuple):
    """A network's outputs for n images."""

    logits: Tensor  # (n, places)
    features: Tensor  # (n, 64) inputs of the last layer, brought to length 1
    heading_deg: Tensor  # (n, places) if that is the place; NaN where the network has no heading

    @property
    def scores(self) -> NDArray[np.float64]:
        """The logits (n, places)."""
        return self.logits.numpy().astype(np.float64)


class Known(NamedTuple):
    """Views of the training sequence, each with its place."""

    seen: Tensor  # (n, rings, sectors) quantized heights, or (n, 64) features
    places: NDArray[np.int64]
    xy_m: NDArray[np.float64]  # (n, 2)

    def some(self, rows: NDArray[np.bool_] | Tensor) -> "Known":
        """Some of them."""
        return Known(self.seen[rows], self.places[rows], self.xy_m[rows])


def judged(
    predict: Callable[[Tensor, Tensor | None], Prediction],
    novelties: Novelties,
    held_out: Known,
    block: NDArray[np.int64],
    place_xy_m: NDArray[np.float64],
    memory: Known,
    neighbour_m: float,
    progress: Progress,
    usual: float | None = None,
) -> tuple[float, Evidence]:
    """The temperature, and the answers to held-out views, once more with the places and training
    views near them forgotten.

    `block` (h,) is the held-out block of each. Where the views fix no temperature, it is the
    `usual` one.
    """
    heights, places, xy_m = held_out
    seen = predict(heights, None)
    unseen = predict(heights, torch.from_numpy(near(xy_m, place_xy_m, neighbour_m)))
    softness = temperature(seen.scores, places)
    if usual is not None and not determined(softness, seen.scores, places):
        softness = usual
    elif not determined(softness, seen.scores, places):
        line = f"the {len(places)} held-out views fix no temperature, {softness:.3g} is used"
        progress.tell(f"{line}: confidence and tempered_entropy are not calibrated")
    cosines, others = (
        (one.features.numpy() @ memory.seen.numpy().T).astype(np.float64) for one in (seen, unseen)
    )
    others[near(xy_m, memory.xy_m, neighbour_m)] = -1
    return softness, Evidence(
        seen.scores.argmax(axis=1) == places,
        novelties(seen.scores, softness, cosines.max(axis=1)),
        novelties(unseen.scores, softness, others.max(axis=1)),
        block,
    )
