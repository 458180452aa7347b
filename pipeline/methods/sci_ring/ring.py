"""SCI's network closed into a ring: turning the image turns what it answers, exactly (METHODS 8.1).

Kim, Park and Kim's layers (RA-L 2019; METHODS 2.4) but that the sectors' last is a neighbour of
their first, that kernels span few sectors, and that the dense layers run at every heading with the
same weights.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pipeline.core.errors import InputError
from pipeline.networks.lenet import FILTERS, start, trunk

# three poolings by two: columns of the image to a sector of the features, and so to a heading
POOLED = 8


SPANS = 3, 3, 1
"""Sectors that the convolutions' kernels span, and 5 rings: a feature sees 42°, so that one new
wall reaches few of them."""


class RingConv(nn.Conv2d):
    """A convolution of 5 rings × `span` sectors that wraps around the sectors.

    It sees zeros beyond the rings.
    """

    def __init__(self, channels: int, filters: int, span: int) -> None:
        super().__init__(channels, filters, (5, span), padding=(2, 0))

    def forward(self, images: Tensor) -> Tensor:
        beyond = self.kernel_size[1] // 2
        sectors = images.shape[3]
        return super().forward(
            torch.cat([images[..., sectors - beyond :], images, images[..., :beyond]], dim=3)
        )


class Ring(nn.Module):
    """Logits over headings and places of images (batch, channels, rings, sectors) in [0, 1].

    Heading h is that of a sensor which is turned by h · 8 columns, counter-clockwise, against the
    one that looks along +x: its image is turned back by as much before FC1 looks at it. An image
    rolled by 8 columns is answered bit for bit as before, its headings rolled by −1. Initialised as
    LeNet is. Raises InputError where 8 does not divide the sectors.
    """

    last_layer = "fc2"
    """The layer with a row a place."""
    by_slice: (
        Tensor  # (heading, slice): which of all products of a sector and a slice are a heading's
    )
    by_sector: Tensor
    """(heading, sector): the same, in the order of the image's sectors."""

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
        if places < 1 or rings < POOLED or sectors < POOLED or sectors % POOLED:
            expected = f"a place or more, {POOLED} rings or more and a multiple of {POOLED} sectors"
            raise InputError(
                f"places={places} rings={rings} sectors={sectors}: expected {expected}"
            )
        sizes = zip(pairwise((channels, *FILTERS)), SPANS, strict=True)
        self.features = trunk((RingConv(*filters, span) for filters, span in sizes), momentum)
        self.headings = sectors // POOLED
        column = 256 * (rings // POOLED)
        self.fc1 = nn.Parameter(torch.empty(self.headings, 64, column))
        """FC1's slice of each sector, the rings' channels one after the other."""
        self.fc1_bias = nn.Parameter(torch.zeros(64))
        self.fc2 = nn.Linear(64, places)
        self.dropout = nn.Dropout(dropout)
        bound = (6 / (self.headings * column + 64)) ** 0.5
        nn.init.uniform_(self.fc1, -bound, bound)
        start(self)
        heading = torch.arange(self.headings)
        seen = (heading - heading[:, None]) % self.headings
        self.register_buffer("by_slice", seen * self.headings + heading, persistent=False)
        self.register_buffer(
            "by_sector",
            heading * self.headings + (heading + heading[:, None]) % self.headings,
            persistent=False,
        )

    def forward(self, images: Tensor, arc: int = 0) -> Tensor:
        """Logits (batch, 1 + arcs, heading, places) of whole images, then without each arc.

        An arc is so many sectors of the features. All are from one pass, since FC1 is linear and an
        arc can be taken off its sum; no arcs with 0.
        """
        if not arc:
            return self.place(self.embed(images))[:, None]
        upto = nn.functional.pad(
            self.products(images)[:, self.by_sector].repeat(1, 1, 2, 1).cumsum(2), (0, 0, 1, 0)
        )
        whole_sum = upto[:, :, self.headings, None]
        without_arc = (
            whole_sum - upto[:, :, arc : arc + self.headings] + upto[:, :, : self.headings]
        )
        return self.place(
            torch.cat([whole_sum, without_arc], dim=2).transpose(1, 2) + self.fc1_bias
        )

    def embed(self, images: Tensor) -> Tensor:
        """FC1's vector at each heading (batch, heading, 64)."""
        embedded: Tensor = self.products(images)[:, self.by_slice].sum(2) + self.fc1_bias
        return embedded

    def products(self, images: Tensor) -> Tensor:
        """Every sector of the features times every slice of FC1 (batch, sector · slice, 64).

        What dropout drops of the features it drops at every heading.
        """
        features: Tensor = self.features(images.contiguous(memory_format=torch.channels_last))
        columns = self.dropout(features.permute(0, 3, 2, 1).flatten(2))
        return (
            nn.functional.linear(columns, self.fc1.flatten(0, 1))
            .float()
            .view(len(images), self.headings**2, 64)
        )

    def place(self, embedded: Tensor) -> Tensor:
        """Logits (…, places) of FC1's vectors (…, 64)."""
        logits: Tensor = self.fc2(self.dropout(embedded))
        return logits
