"""Encoding and decoding bird-views with trained networks: batch norms use their running statistics (METHODS 5.2)."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.matching.ranking import Model
from pipeline.methods.pfl.adversarial import pixels
from pipeline.methods.pfl.bigan import Decoder, Encoder, folded
from pipeline.networks import loop
from pipeline.networks.lenet import device

ENCODER, DECODER = "net/encoder.", "net/decoder."
AT_ONCE = 256
"""Images encoded at a time."""


def encoder(model: Model, precision: Literal["auto", "bf16", "f32"]) -> Encoder:
    """A model's encoder at this precision, its batch norms folded into the convolutions."""
    kind = device().type
    with loop.autocast(device(), precision):
        dtype = torch.get_autocast_dtype(kind) if torch.is_autocast_enabled(kind) else torch.float32
    return folded(_loaded(Encoder(*_sizes(model)), model, ENCODER), dtype)


def decoder(model: Model) -> Decoder:
    """A model's decoder."""
    return _loaded(Decoder(*_sizes(model)), model, DECODER)


def batched(net: Callable[[Tensor], Tensor]) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
    """A network's answers to images (n, 64, 64), AT_ONCE at a time."""

    @torch.inference_mode()
    def answer(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        starts = range(0, max(len(images), 1), AT_ONCE)
        return torch.cat([net(pixels(images[i : i + AT_ONCE], device())).float().cpu() for i in starts]).numpy()

    return answer


def _sizes(model: Model) -> tuple[int, int, int]:
    """Width, channels and code length of the networks in a model, whatever the method's settings are."""
    width, channels = model[f"{ENCODER}halvings.0.0.weight"].shape[:2]
    return width, channels, len(model[f"{ENCODER}dense.bias"])


def _loaded(net: loop.Net, model: Model, prefix: str) -> loop.Net:
    """The network with its weights in the model, in evaluation mode."""
    part = {name.removeprefix(prefix): array for name, array in model.items() if name.startswith(prefix)}
    net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in part.items()})
    return net.eval().to(device())
