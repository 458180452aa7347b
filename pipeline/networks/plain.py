"""The trained networks of `sci` and `sci_ring` in plain NumPy, so that a robot needs no torch.

In: a model's weights, and the heights of a Scan Context Image. Out: the score and heading of each
place, and the features. The layers are those of `lenet` and of `ring` (METHODS 2.4, 8.1), the
arithmetic is float32. Importing torch takes over a second, more than all other steps before a first
fix.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from pipeline.core.frames import wrapped_deg
from pipeline.views.scan_context import colours, quantize

Floats = NDArray[np.float32]
Weights = Mapping[str, NDArray[Any]]
NET = "net/"
"""Prefix of the weights within a model."""
RING = f"{NET}fc1"
"""Name of the weights of the first dense layer (FC1) in a model of `sci_ring`: a slice a sector."""
LENET = f"{NET}head.2.weight"
"""Name of the weights of the first dense layer in a model of `sci`."""
CONVOLUTIONS = (("features.0", "features.3"), ("features.4", "features.7"), ("features.8", ""))
"""Names of each convolution and of the batch norm behind it; the last has no batch norm."""
EPSILON = 1e-3
"""What the batch norms add to the variance."""
HEADING_TEMPERATURE = 2.0
"""Temperature of the softmax over a place's headings, whose circular mean is the answer: at 1 the
mean is drawn to the nearest heading. Chosen on validation blocks of two simulated worlds."""


@dataclass(frozen=True)
class Layer:
    """A convolution, then pooling by 2 × 2, the ReLU and the batch norm."""

    kernels: Floats
    """(rows · columns · channels, filters) the convolution as a matrix."""
    bias: Floats
    """(filters,) bias of the convolution."""
    rows: int
    columns: int
    """Size of the kernels in pixels; rows are rings, columns are sectors."""
    wraps: bool
    """Whether the convolution wraps around the sectors."""
    scale: Floats
    """(filters,) the factor of the batch norm."""
    offset: Floats
    """(filters,) what the batch norm adds."""

    def __call__(self, image: Floats) -> Floats:
        """The features (rings / 2, sectors / 2, filters) of an image (rings, sectors, channels)."""
        above = self.rows // 2
        aside = self.columns // 2
        padding: Literal["wrap", "constant"] = "wrap" if self.wraps else "constant"
        padded = np.pad(image, ((above, above), (0, 0), (0, 0)))
        padded = np.pad(padded, ((0, 0), (aside, aside), (0, 0)), mode=padding)
        rings, sectors, channels = image.shape
        # A view of all windows without a copy: a row of a window is one piece of memory.
        windows = np.lib.stride_tricks.as_strided(
            padded,
            (rings, sectors, self.rows, self.columns * channels),
            (*padded.strides[:2], padded.strides[0], padded.strides[2]),
            writeable=False,
        )
        filtered = windows.reshape(rings * sectors, -1) @ self.kernels
        filtered = filtered.reshape(rings, sectors, -1)[: rings // 2 * 2, : sectors // 2 * 2]
        pooled_rows = np.maximum(filtered[0::2], filtered[1::2])
        pooled = np.maximum(pooled_rows[:, 0::2], pooled_rows[:, 1::2]) + self.bias
        return np.asarray(np.maximum(pooled, np.float32(0)) * self.scale + self.offset)


class Outputs(NamedTuple):
    """A network's answer to one image."""

    scores: Floats
    """(places,) the logit of each place."""
    features: Floats
    """(64,) inputs of the last layer, scaled to length 1."""
    heading_deg: Floats
    """(places,) the heading if the place is right; NaN for a network without headings."""


@dataclass(frozen=True)
class Plain:
    """A trained network of `sci` or `sci_ring`."""

    weights: Weights
    """The network's weights by their names in torch."""
    layers: tuple[Layer, ...]
    """The convolutions."""
    colour: Floats
    """(256, channels) the colour of each quantized height."""
    h_min_m: float
    h_max_m: float
    """Heights are clipped to [h_min_m, h_max_m] before they are quantized."""

    @classmethod
    def is_in(cls, model: Weights) -> bool:
        """Whether a model has the weights of one of these networks."""
        return RING in model or LENET in model

    @classmethod
    def of(
        cls,
        model: Weights,
        colormap: Literal["jet", "grey"] = "jet",
        h_min_m: float = 0.0,
        h_max_m: float = 15.0,
    ) -> Self:
        """The network of a model, with the method's settings for heights."""
        weights = {
            name.removeprefix(NET): np.asarray(array)
            for name, array in model.items()
            if name.startswith(NET)
        }
        layers = tuple(_layer(weights, *names, wraps=RING in model) for names in CONVOLUTIONS)
        colour = (colours(colormap).astype(np.float32) / np.float32(255)).astype(np.float32)
        return cls(weights, layers, colour, h_min_m, h_max_m)

    def __call__(self, heights_m: NDArray[np.float32]) -> Outputs:
        """Answer for heights (rings, sectors) in metres."""
        image = self.colour[quantize(heights_m, self.h_min_m, self.h_max_m)]
        for layer in self.layers:
            image = layer(image)
        return self._ring(image) if "fc1" in self.weights else self._lenet(image)

    def _lenet(self, features: Floats) -> Outputs:
        """The dense layers of `sci`'s network."""
        weights = self.weights
        embedded = weights["head.2.weight"] @ features.transpose(2, 0, 1).ravel()
        embedded = embedded + weights["head.2.bias"]
        scores = weights["head.4.weight"] @ embedded + weights["head.4.bias"]
        return Outputs(scores, _of_length_1(embedded), np.full_like(scores, np.nan))

    def _ring(self, features: Floats) -> Outputs:
        """The dense layers of `sci_ring`'s network, at every heading (methods.sci_ring.ring)."""
        weights = self.weights
        count, width, _ = weights["fc1"].shape
        # FC1: the product of every sector with every slice, summed for each heading.
        columns = features.transpose(1, 0, 2).reshape(count, -1)
        products = columns @ weights["fc1"].reshape(count * width, -1).T
        products = products.reshape(count, count, width)
        slices = np.arange(count)
        sectors = (slices - slices[:, None]) % count  # (heading, slice)
        embedded = products[sectors, slices].sum(axis=1) + weights["fc1_bias"]
        # FC2, and each place's score and heading.
        logits = embedded @ weights["fc2.weight"].T + weights["fc2.bias"]  # (heading, place)
        scores = logsumexp(logits, axis=0)
        heading_deg = _circular_mean_deg(softmax(logits / HEADING_TEMPERATURE, axis=0))
        # The features at the heading of the first place, interpolated between two headings.
        first_heading = heading_deg[scores.argmax()] * (count / 360)
        lower = int(np.floor(first_heading))
        share = np.float32(first_heading - lower)
        lower_row = embedded[lower % count]
        upper_row = embedded[(lower + 1) % count]
        interpolated = lower_row + share * (upper_row - lower_row)
        return Outputs(scores, _of_length_1(interpolated), heading_deg)


def _layer(weights: Weights, convolution: str, norm: str, wraps: bool) -> Layer:
    """The layer of a convolution and the batch norm behind it, by their names."""
    kernels = weights[f"{convolution}.weight"]  # (filters, channels, rows, columns)
    filters, _, rows, columns = kernels.shape
    scale: NDArray[Any] = np.ones(filters, np.float32)
    offset: NDArray[Any] = np.zeros(filters, np.float32)
    if norm:
        scale = weights[f"{norm}.weight"] / np.sqrt(weights[f"{norm}.running_var"] + EPSILON)
        offset = weights[f"{norm}.bias"] - weights[f"{norm}.running_mean"] * scale
    flat = np.ascontiguousarray(kernels.transpose(2, 3, 1, 0).reshape(-1, filters))
    return Layer(flat, weights[f"{convolution}.bias"], rows, columns, wraps, scale, offset)


def _circular_mean_deg(probabilities: NDArray[Any]) -> NDArray[Any]:
    """The circular mean heading (n,) in degrees of probabilities (heading, n)."""
    angles_rad = np.linspace(0, 2 * np.pi, len(probabilities), endpoint=False, dtype=np.float32)
    return wrapped_deg(
        np.rad2deg(
            np.arctan2(np.sin(angles_rad) @ probabilities, np.cos(angles_rad) @ probabilities)
        )
    )


def _of_length_1(vector: NDArray[Any]) -> NDArray[Any]:
    """A vector scaled to length 1."""
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
