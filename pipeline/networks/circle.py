"""Headings around the circle, of images that turn by rolling their columns."""

import torch
from torch import Tensor


def neighbours(headings: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """The two of `count` headings around each fractional one (n,), and its share between them.

    The share (n,) is how far it is from the first to the second.
    """
    below = headings.floor()
    lower = below.long() % count
    return lower, (lower + 1) % count, headings - below


def rolled(heights: Tensor, turns: Tensor) -> Tensor:
    """Heights (n, rings, sectors), each rolled by its own number of columns (n,)."""
    turns = turns.to(heights.device)
    columns = torch.arange(heights.shape[2], device=heights.device) - turns[:, None]
    columns %= heights.shape[2]
    return heights.gather(2, columns[:, None].expand_as(heights))


def circular_mean_deg(chances: Tensor) -> Tensor:
    """Circular mean (n, …), in (−180, 180] degrees, of chances (n, heading, …).

    Headings are even around the circle, the first at 0.
    """
    angles = 2 * torch.pi * torch.arange(chances.shape[1], device=chances.device) / chances.shape[1]
    north, east = (
        torch.tensordot(part, chances, dims=([0], [1])) for part in (angles.sin(), angles.cos())
    )
    turned = torch.atan2(north, east).rad2deg()
    return 180 - (180 - turned) % 360
