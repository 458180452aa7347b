"""The SCI paper's network (Table I): a Scan Context Image in, a logit for each place out.

It has three convolutions and two dense layers (METHODS 2.4). The network of `sci_ring` also uses
`trunk` and `initialise`; all networks use `device` and `to_device`.
"""

from collections.abc import Iterable
from itertools import pairwise

import torch
from torch import Tensor, nn

from pipeline.core.errors import InputError

FILTERS = 64, 128, 256
"""Number of filters of the three convolutions."""


class LeNet(nn.Module):
    """Logits (batch, places) of images (batch, channels, rings, sectors) in [0, 1].

    `momentum` is the weight of a new batch in the batch norms' running statistics, which is 1 −
    0.99 in Keras. For 579 places the network has 2,296,515 numbers, 384 of them running statistics.
    """

    last_layer = "head.4"
    """The layer with a row for each place."""

    def __init__(
        self,
        places: int,
        rings: int = 40,
        sectors: int = 120,
        channels: int = 3,
        dropout: float = 0.7,
        momentum: float = 0.01,
    ) -> None:
        super().__init__()
        if places < 1 or rings < 8 or sectors < 8:
            raise InputError(
                f"places={places} rings={rings} sectors={sectors}: expected a place or more and "
                "sides of 8 or more"
            )
        self.features = trunk(
            (nn.Conv2d(*sizes, 5, padding=2) for sizes in pairwise((channels, *FILTERS))), momentum
        )
        # The first three layers make the inputs of the last one (`embed`), the others the logits.
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(FILTERS[-1] * (rings // 8) * (sectors // 8), 64),
            nn.Dropout(dropout),
            nn.Linear(64, places),
        )
        initialise(self)

    def forward(self, images: Tensor) -> Tensor:
        return self.place_logits(self.embed(images))

    def embed(self, images: Tensor) -> Tensor:
        """The inputs of the last layer (batch, 64)."""
        features: Tensor = self.features(images.contiguous(memory_format=torch.channels_last))
        embedded: Tensor = self.head[:3](features.contiguous())
        return embedded

    def place_logits(self, embedded: Tensor) -> Tensor:
        """Logits (batch, places) from the inputs of the last layer (batch, 64)."""
        logits: Tensor = self.head[3:](embedded)
        return logits


def trunk(convolutions: Iterable[nn.Conv2d], momentum: float) -> nn.Sequential:
    """Layers from images to features (batch, 256, rings // 8, sectors // 8).

    They are the three given convolutions, with pooling, ReLU and batch norms. Each pooling halves
    both sides. It comes before the ReLU, which then has a quarter of the work and gives the same
    bits.
    """
    first_convolution, second_convolution, third_convolution = convolutions
    norms = [nn.BatchNorm2d(filters, eps=1e-3, momentum=momentum) for filters in FILTERS]
    return nn.Sequential(
        first_convolution,
        nn.MaxPool2d(2),
        nn.ReLU(),
        norms[0],
        second_convolution,
        nn.MaxPool2d(2),
        nn.ReLU(),
        norms[1],
        third_convolution,
        nn.MaxPool2d(2),
        nn.ReLU(),
    )


def initialise(net: nn.Module) -> None:
    """Initialise as Keras does: Glorot uniform kernels, zero biases."""
    for module in net.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            nn.init.zeros_(module.bias)  # type: ignore[arg-type]
        if isinstance(module, nn.Conv2d):  # twice as fast on a CPU
            module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)


def device() -> torch.device:
    """The device of all networks: a GPU if there is one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def to_device(tensor: Tensor, torch_device: torch.device) -> Tensor:
    """Copy a tensor from the processor to a device, without waiting.

    Plain `to` waits for the copy, and for all computations on the device.
    """
    if torch_device.type == "cpu":
        return tensor
    return tensor.pin_memory().to(torch_device, non_blocking=True)
