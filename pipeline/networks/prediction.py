"""What a network over Scan Context Images puts out (METHODS 2.4)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

Kinds = dict[str, NDArray[np.float64]]
"""Kind of novelty to its values (n,)."""


class Prediction(NamedTuple):
    """A network's outputs for n images."""

    logits: Tensor
    """(n, places)"""
    features: Tensor
    """(n, 64) inputs of the last layer, brought to length 1."""
    heading_deg: Tensor
    """(n,) NaN where the network has no heading."""


class TrainingEmbeddings(NamedTuple):
    """Features of training views, as the network sees them after training."""

    features: Tensor
    """(m, 64) of length 1."""
    rows: Tensor
    """(m,) the training view that each belongs to."""
