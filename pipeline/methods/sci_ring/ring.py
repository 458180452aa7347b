"""SCI's network closed into a ring, so that turning the image exactly turns the answer (METHODS
8.1).

In: Scan Context Images, whose columns are sectors around the robot. Out: a logit for each place at
each heading. The layers are those of Kim, Park and Kim (RA-L 2019; METHODS 2.4), with three
changes:

- the last sector is a neighbour of the first, so that convolutions wrap around;
- kernels span few sectors;
- the dense layers are applied to the features at every heading, with the same weights.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from pipeline.core.errors import InputError
from pipeline.networks.lenet import FILTERS, initialise, trunk

POOLED = 8
"""The number of image columns per sector of the features, since three layers pool by two. A heading
is a sector."""
SPANS = 3, 3, 1
"""The number of sectors that the kernels of the three convolutions span (beside 5 rings). A feature
then sees 42°, so that a new wall changes few features."""


class RingConv(nn.Conv2d):
    """A convolution of 5 rings × `span` sectors that wraps around the sectors.

    Beyond the first and the last ring it is padded with zeros.
    """

    def __init__(self, channels: int, filters: int, span: int) -> None:
        super().__init__(channels, filters, (5, span), padding=(2, 0))

    def forward(self, images: Tensor) -> Tensor:
        # Pad each side with as many sectors of the other end as the kernel reaches beyond it.
        reach = self.kernel_size[1] // 2
        sectors = images.shape[3]
        return super().forward(
            torch.cat([images[..., sectors - reach :], images, images[..., :reach]], dim=3)
        )


class Ring(nn.Module):
    """Logits over headings and places of images (batch, channels, rings, sectors) in [0, 1].

    Heading h is the heading of a sensor that is turned counter-clockwise by h · 8 columns from +x.
    For this heading, the features are turned back by h sectors before the first dense layer, FC1.
    So if an image is rolled by 8 columns, the answer is the same bit for bit, with the headings
    rolled by −1. The weights are initialised like LeNet's. Raises InputError if 8 does not divide
    the number of sectors.

    FC1's weights are cut into slices, one for each sector of its input. Instead of turning the
    features, every sector is multiplied with every slice once (`products`), and each heading sums
    the products that belong to it.
    """

    last_layer = "fc2"
    """The layer with one row for each place."""
    by_slice: Tensor
    """(heading, slice) the indices of the products that a heading sums, slice by slice."""
    by_sector: Tensor
    """(heading, sector) the same indices, sector by sector of the image."""

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
        column_size = FILTERS[-1] * (rings // POOLED)
        self.fc1 = nn.Parameter(torch.empty(self.headings, 64, column_size))
        """(slice, 64, column_size) FC1's slices; a column has the channels of all rings of a
        sector."""
        self.fc1_bias = nn.Parameter(torch.zeros(64))
        self.fc2 = nn.Linear(64, places)
        self.dropout = nn.Dropout(dropout)
        bound = (6 / (self.headings * column_size + 64)) ** 0.5  # Glorot's, of inputs and outputs
        nn.init.uniform_(self.fc1, -bound, bound)
        initialise(self)
        # Product number sector · headings + slice; at heading h, the input of slice s is sector
        # s − h.
        index = torch.arange(self.headings)
        heading = index[:, None]
        sector_of_slice = (index - heading) % self.headings
        by_slice = sector_of_slice * self.headings + index
        slice_of_sector = (index + heading) % self.headings
        by_sector = index * self.headings + slice_of_sector
        self.register_buffer("by_slice", by_slice, persistent=False)
        self.register_buffer("by_sector", by_sector, persistent=False)

    def forward(self, images: Tensor, arc: int = 0) -> Tensor:
        """Logits (batch, 1 + arcs, heading, places) of whole images, then without each arc.

        An arc is `arc` neighbouring sectors of the features, and an arc begins at every sector;
        with 0 there are no arcs. All logits come from one pass: FC1 is linear, so an arc can be
        subtracted from its sum.
        """
        if not arc:
            return self.place_logits(self.embed(images))[:, None]
        # Sums of the first sectors, twice around the circle, so that an arc may wrap.
        products = self.products(images)[:, self.by_sector].repeat(1, 1, 2, 1)
        sum_up_to = nn.functional.pad(products.cumsum(2), (0, 0, 1, 0))
        whole_sum = sum_up_to[:, :, self.headings, None]
        arc_ends = sum_up_to[:, :, arc : arc + self.headings]
        arc_starts = sum_up_to[:, :, : self.headings]
        without_arc = whole_sum - arc_ends + arc_starts
        sums = torch.cat([whole_sum, without_arc], dim=2).transpose(1, 2)
        return self.place_logits(sums + self.fc1_bias)

    def embed(self, images: Tensor) -> Tensor:
        """FC1's output at each heading (batch, heading, 64)."""
        embedded: Tensor = self.products(images)[:, self.by_slice].sum(2) + self.fc1_bias
        return embedded

    def products(self, images: Tensor) -> Tensor:
        """Every sector of the features times every slice of FC1 (batch, sector · slice, 64).

        Dropout drops the same features at every heading.
        """
        features: Tensor = self.features(images.contiguous(memory_format=torch.channels_last))
        columns = self.dropout(features.permute(0, 3, 2, 1).flatten(2))
        products = nn.functional.linear(columns, self.fc1.flatten(0, 1)).float()
        return products.view(len(images), self.headings**2, 64)

    def place_logits(self, embedded: Tensor) -> Tensor:
        """Logits (…, places) from FC1's output (…, 64)."""
        logits: Tensor = self.fc2(self.dropout(embedded))
        return logits


def neighbours(headings: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """The two of `count` headings between which each fractional heading (n,) lies.

    Returns the lower headings (n,), the upper headings (n,), and the position (n,) of each heading
    between them, from 0 to 1.
    """
    below = headings.floor()
    lower = below.long() % count
    return lower, (lower + 1) % count, headings - below


def circular_mean_deg(probabilities: Tensor) -> Tensor:
    """The circular mean heading (n, …), in (−180, 180] degrees, of probabilities (n, heading, …).

    The headings are evenly spaced around the circle, the first at 0.
    """
    count = probabilities.shape[1]
    angles = 2 * torch.pi * torch.arange(count, device=probabilities.device) / count
    mean_sine = torch.tensordot(angles.sin(), probabilities, dims=([0], [1]))
    mean_cosine = torch.tensordot(angles.cos(), probabilities, dims=([0], [1]))
    mean_deg = torch.atan2(mean_sine, mean_cosine).rad2deg()
    return 180 - (180 - mean_deg) % 360
