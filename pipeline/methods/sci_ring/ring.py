"""Table I's network closed into a ring: turning the image turns what it answers, exactly (METHODS 8.1).

Kim, Park and Kim's layers (RA-L 2019; METHODS 2.4) but that the sectors' last is a neighbour of their first, and that the
dense layers run at every heading with the same weights.
"""

import torch
from torch import Tensor, nn

from pipeline.errors import InputError
from pipeline.networks.lenet import start, trunk

POOLED = 8  # three poolings by two: columns of the image to a sector of the features, and so to a heading


class RingConv(nn.Conv2d):
    """A 5 × 5 convolution that wraps around the sectors, its width, and sees zeros beyond the first and the last ring."""

    def __init__(self, channels: int, filters: int) -> None:
        super().__init__(channels, filters, 5, padding=(2, 0))

    def forward(self, images: Tensor) -> Tensor:
        return super().forward(torch.cat([images[..., -2:], images, images[..., :2]], dim=3))


class Ring(nn.Module):
    """Logits (batch, heading, places) of images (batch, channels, rings, sectors) in [0, 1].

    Heading h is that of a sensor which is turned by h · 8 columns, counter-clockwise, against the one that looks along +x: its
    image is turned back by as much before FC1 looks at it. An image rolled by 8 columns is answered bit for bit as before, its
    headings rolled by −1. Initialised as LeNet is, and of as many numbers. Raises InputError where 8 does not divide the
    sectors.
    """

    pairs: Tensor  # (heading, sector): which of all products of a column and a slice are a heading's, in the order of the slices

    def __init__(
        self, places: int, rings: int = 40, sectors: int = 120, channels: int = 3, dropout: float = 0.7, momentum: float = 0.01
    ) -> None:
        super().__init__()
        if places < 1 or rings < POOLED or sectors < POOLED or sectors % POOLED:
            expected = f"a place or more, {POOLED} rings or more and a multiple of {POOLED} sectors"
            raise InputError(f"places={places} rings={rings} sectors={sectors}: expected {expected}")
        self.features = trunk(RingConv, channels, momentum)
        self.headings, column = sectors // POOLED, 256 * (rings // POOLED)
        self.fc1 = nn.Parameter(torch.empty(self.headings, 64, column))
        """FC1's slice of each sector, the rings' channels one after the other."""
        self.fc1_bias = nn.Parameter(torch.zeros(64))
        self.fc2 = nn.Linear(64, places)
        self.dropout = nn.Dropout(dropout)
        bound = (6 / (self.headings * column + 64)) ** 0.5
        nn.init.uniform_(self.fc1, -bound, bound)
        start(self)
        sector = torch.arange(self.headings)
        turned = (sector - sector[:, None]) % self.headings
        self.register_buffer("pairs", turned * self.headings + sector, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        return self.place(self.embed(images))

    def embed(self, images: Tensor) -> Tensor:
        """FC1's vector at each heading (batch, heading, 64): every sector times every slice at once, then sums along the ring.

        What dropout drops of the features it drops at every heading.
        """
        features: Tensor = self.features(images.contiguous(memory_format=torch.channels_last))
        columns = self.dropout(features.permute(0, 3, 2, 1).flatten(2))
        products = nn.functional.linear(columns, self.fc1.flatten(0, 1)).float().view(len(images), self.headings**2, 64)
        embedded: Tensor = products[:, self.pairs].sum(2) + self.fc1_bias
        return embedded

    def place(self, embedded: Tensor) -> Tensor:
        """Logits (…, places) of FC1's vectors (…, 64)."""
        logits: Tensor = self.fc2(self.dropout(embedded))
        return logits
