"""Tests of headings around the circle, and of images that turn by rolling."""

import numpy as np
import torch

from pipeline.networks.circle import circular_mean_deg, neighbours, rolled


def test_a_heading_lies_between_the_two_next_to_it_even_across_the_end() -> None:
    first, second, share = neighbours(torch.tensor([0.25, 3.5, -0.75]), 4)
    assert (first.tolist(), second.tolist()) == ([0, 3, 3], [1, 0, 0])
    np.testing.assert_allclose(share, [0.25, 0.5, 0.25])


def test_headings_are_averaged_around_the_circle() -> None:
    # Of four: half at 0° and half at 90° is 45°; half at 0° and half at 270° is −45°; all at 180°
    # is 180°, not −180°.
    chances = torch.tensor([[0.5, 0.5, 0, 0], [0.5, 0, 0, 0.5], [0, 0, 1, 0]])
    np.testing.assert_allclose(circular_mean_deg(chances), [45, -45, 180], atol=1e-4)


def test_each_image_is_rolled_by_its_own_columns() -> None:
    heights = torch.arange(4, dtype=torch.uint8).expand(2, 3, 4)
    turned = rolled(heights, torch.tensor([1, -1]))
    assert turned[:, 0].tolist() == [[3, 0, 1, 2], [1, 2, 3, 0]]
