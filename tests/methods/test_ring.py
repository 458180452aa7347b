"""Tests of the network on a ring: its numbers are counted, and a turned image gives a turned answer
(METHODS 8.1)."""

import numpy as np
import pytest
import torch

from pipeline.core.errors import InputError
from pipeline.methods.sci_ring.ring import Ring, circular_mean_deg, neighbours


@pytest.fixture(scope="module")
def net() -> Ring:
    torch.manual_seed(0)
    return Ring(7).eval()


@pytest.fixture(scope="module")
def image() -> torch.Tensor:
    return torch.rand(2, 3, 40, 120, generator=torch.Generator().manual_seed(1))


def test_features_are_five_rings_and_fifteen_sectors(net: Ring, image: torch.Tensor) -> None:
    with torch.inference_mode():
        assert net.features(image).shape == (2, 256, 5, 15)
        assert net.embed(image).shape == (2, 15, 64)
        assert net(image).shape == (2, 1, 15, 7)


@pytest.mark.parametrize("sectors", [1, 4, 14])
def test_a_turned_image_is_answered_bit_for_bit_at_turned_headings(
    net: Ring, image: torch.Tensor, sectors: int
) -> None:
    with torch.inference_mode():
        assert torch.equal(net(image.roll(8 * sectors, 3)), net(image).roll(-sectors, 2))


@pytest.mark.parametrize("heading", [0, 1, 9])
def test_a_heading_is_the_dense_layer_on_features_turned_back_by_it(
    net: Ring, image: torch.Tensor, heading: int
) -> None:
    """A sensor turned to the left by `heading` sees all that much further to the right, in sectors
    of lower number."""
    with torch.inference_mode():
        upright = net.features(image.roll(8 * heading, 3))
        dense = net.fc1.permute(1, 0, 2).flatten(1)  # (64, sector · ring · channel)
        columns = torch.stack(
            [upright[:, :, :, sector].transpose(1, 2).flatten(1) for sector in range(15)], dim=1
        )
        expected = columns.flatten(1) @ dense.T + net.fc1_bias
        torch.testing.assert_close(net.embed(image)[:, heading], expected, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("arc", [1, 3, 14])
def test_logits_without_an_arc_are_those_of_features_that_are_empty_there(
    net: Ring, image: torch.Tensor, arc: int
) -> None:
    with torch.inference_mode():
        logits = net(image, arc)
        assert logits.shape == (2, 16, 15, 7)
        torch.testing.assert_close(logits[:, :1], net(image), atol=1e-4, rtol=1e-4)
        features = net.features(image)
        for first in (0, 4, 13):
            sectors = [(first + further) % 15 for further in range(arc)]
            emptied = features.clone()
            emptied[..., sectors] = 0
            again = Ring(7).eval()
            again.load_state_dict(net.state_dict())
            again.features = torch.nn.Sequential(torch.nn.Identity())
            torch.testing.assert_close(
                logits[:, 1 + first], again(emptied)[:, 0], atol=1e-4, rtol=1e-4
            )


def test_a_feature_sees_fourteen_columns(net: Ring, image: torch.Tensor) -> None:
    """8 of its own sector and 3 more on each side, of 120."""
    with torch.inference_mode():
        plain = net.features(image)[..., 7]
        reached = []
        for column in range(120):
            changed = image.clone()
            changed[..., column] = 1 - changed[..., column]
            if not torch.equal(net.features(changed)[..., 7], plain):
                reached.append(column)
    assert reached == list(range(53, 67))


def test_the_seam_is_seen_and_the_rims_are_not_joined() -> None:
    """One bright pixel in the last sector reaches the first, one in the last ring not the first."""
    torch.manual_seed(0)
    net = Ring(2).eval()
    dark, seam, rim = (torch.zeros(1, 3, 40, 120) for _ in range(3))
    seam[..., 20, 119] = 1
    rim[..., 39, 60] = 1
    with torch.inference_mode():
        changed = [
            (net.features(bright) - net.features(dark)).abs().sum((0, 1)) > 0
            for bright in (seam, rim)
        ]
    assert changed[0][:, 0].any()
    assert changed[0][:, 14].any()
    assert changed[1][4].any()
    assert not changed[1][0].any()


def test_what_is_dropped_of_the_features_is_dropped_at_every_heading(image: torch.Tensor) -> None:
    """In a ring that looks the same all around, all headings stay the same if they share one mask
    that drops whole images."""
    torch.manual_seed(0)
    net = Ring(2, dropout=1.0).train()
    embedded = net.embed(image)
    assert torch.equal(embedded, net.fc1_bias.expand_as(embedded))
    half = Ring(2, dropout=0.5).train()
    with torch.no_grad():
        # All slices are equal: a heading sums the same kept columns
        half.fc1.copy_(half.fc1[:1].expand_as(half.fc1))
        embedded = half.embed(image)
    torch.testing.assert_close(embedded, embedded[:, :1].expand_as(embedded), atol=1e-5, rtol=1e-4)


def test_the_slices_of_fc1_start_within_glorots_bound_of_the_whole() -> None:
    torch.manual_seed(0)
    net = Ring(579)
    assert not net.fc1_bias.any()
    bound = (6 / (19200 + 64)) ** 0.5
    assert 0.99 * bound < float(net.fc1.detach().abs().max()) <= bound


@pytest.mark.parametrize(
    ("places", "rings", "sectors"),
    [(0, 40, 120), (5, 7, 120), (5, 40, 0), (5, 40, 60), (5, 40, 124)],
)
def test_sectors_that_do_not_pool_to_whole_headings_are_refused(
    places: int, rings: int, sectors: int
) -> None:
    with pytest.raises(InputError, match="multiple of 8 sectors"):
        Ring(places, rings, sectors)


def test_a_heading_lies_between_the_two_next_to_it_even_across_the_end() -> None:
    first, second, share = neighbours(torch.tensor([0.25, 3.5, -0.75]), 4)
    assert (first.tolist(), second.tolist()) == ([0, 3, 3], [1, 0, 0])
    np.testing.assert_allclose(share, [0.25, 0.5, 0.25])


def test_headings_are_averaged_around_the_circle() -> None:
    # Of four: half at 0° and half at 90° is 45°; half at 0° and half at 270° is −45°; all at 180°
    # is 180°, not −180°.
    probabilities = torch.tensor([[0.5, 0.5, 0, 0], [0.5, 0, 0, 0.5], [0, 0, 1, 0]])
    np.testing.assert_allclose(circular_mean_deg(probabilities), [45, -45, 180], atol=1e-4)
