"""Headings around the circle: helpers of the networks that tell headings.

An image whose columns are sectors around the robot turns by rolling its columns.
"""

import torch
from torch import Tensor


def neighbours(headings: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """The two of `count` headings (n,) between which each fractional heading (n,) lies.

    Returns the lower ones, the upper ones, and how far (n,) each heading is from the lower to the
    upper one, from 0 to 1.
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
    """The circular mean heading (n, …), in (−180, 180] degrees, of chances (n, heading, …).

    The headings are evenly spaced around the circle, the first at 0.
    """
    count = chances.shape[1]
    angles = 2 * torch.pi * torch.arange(count, device=chances.device) / count
    mean_sine = torch.tensordot(angles.sin(), chances, dims=([0], [1]))
    mean_cosine = torch.tensordot(angles.cos(), chances, dims=([0], [1]))
    mean_deg = torch.atan2(mean_sine, mean_cosine).rad2deg()
    return 180 - (180 - mean_deg) % 360
