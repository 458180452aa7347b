"""Tests of the SCI paper's network: its numbers are counted (METHODS 2.4)."""

import pytest
import torch

from pipeline.core.errors import InputError
from pipeline.methods.sci_ring.ring import Ring
from pipeline.networks.lenet import LeNet


@pytest.fixture(scope="module")
def net() -> LeNet:
    torch.manual_seed(0)
    return LeNet(579)


def parameters(net: torch.nn.Module) -> int:
    """Numbers a network holds, the batch norms' running statistics included, as Keras counts
    them."""
    return sum(
        value.numel()
        for name, value in net.state_dict().items()
        if not name.endswith("num_batches_tracked")
    )


def test_the_paper_counts_2_296_515_numbers_65_of_them_a_place() -> None:
    # 4864 + 256 + 204928 + 512 + 819456 + 1228864 + 37635, of which the batch norms' 2 · (64 + 128)
    # are not trained.
    for places in (1, 7, 579, 700):
        assert parameters(LeNet(places)) == 2_296_515 + 65 * (places - 579)
    assert sum(value.numel() for value in LeNet(579).parameters()) == 2_296_131


def test_the_rings_kernels_of_fewer_columns_take_739_200_numbers_off() -> None:
    # 5 × 3, 5 × 3 and 5 × 1 instead of 5 × 5: 64 · 3 · 10 + 128 · 64 · 10 + 256 · 128 · 20.
    assert parameters(Ring(579)) == 2_296_515 - 739_200
    assert parameters(LeNet(1, 17, 24)) - parameters(Ring(1, 17, 24)) == 739_200


@pytest.mark.parametrize("batch", [1, 2])
def test_an_image_has_a_logit_for_each_place(net: LeNet, batch: int) -> None:
    with torch.inference_mode():
        assert net.eval()(torch.rand(batch, 3, 40, 120)).shape == (batch, 579)


def test_layers_are_those_of_the_table(net: LeNet) -> None:
    # After each block: 20×60×64, 10×30×128, 5×15×256.
    shapes = []
    with torch.inference_mode():
        image = torch.rand(1, 3, 40, 120)
        for layer in net.eval().features:
            image = layer(image)
            if isinstance(layer, torch.nn.MaxPool2d):
                shapes.append(tuple(image.shape[1:]))
    assert shapes == [(64, 20, 60), (128, 10, 30), (256, 5, 15)]
    norms = [layer for layer in net.features if isinstance(layer, torch.nn.BatchNorm2d)]
    assert [(norm.eps, norm.momentum) for norm in norms] == [(1e-3, 0.01)] * 2
    assert [layer.p for layer in net.head if isinstance(layer, torch.nn.Dropout)] == [0.7, 0.7]


@pytest.mark.parametrize("kind", [LeNet, Ring])
def test_biases_start_at_zero_and_kernels_within_glorots_bound(kind: type[torch.nn.Module]) -> None:
    torch.manual_seed(0)
    for layer in kind(579).modules():
        if isinstance(layer, torch.nn.Conv2d | torch.nn.Linear):
            assert layer.bias is not None
            assert not layer.bias.any()
            taps = layer.weight[0, 0].numel() if layer.weight.ndim == 4 else 1
            bound = (6 / (taps * (layer.weight.shape[0] + layer.weight.shape[1]))) ** 0.5
            assert 0.98 * bound < float(layer.weight.detach().abs().max()) <= bound


def test_other_sizes_are_pooled_down_to_whole_numbers() -> None:
    # 20 × 61: 10 × 30, 5 × 15, 2 × 7 of 256 channels.
    small = LeNet(3, 20, 61, channels=1).eval()
    with torch.inference_mode():
        assert small(torch.rand(2, 1, 20, 61)).shape == (2, 3)
    assert small.head[2].in_features == 2 * 7 * 256  # type: ignore[union-attr]


@pytest.mark.parametrize(("places", "rings", "sectors"), [(0, 40, 120), (5, 7, 120), (5, 40, 7)])
def test_images_too_small_for_three_poolings_are_refused(
    places: int, rings: int, sectors: int
) -> None:
    with pytest.raises(InputError):
        LeNet(places, rings, sectors)
