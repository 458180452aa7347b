"""Tests of NetVLAD and the whole PointNetVLAD network: counted and worked out by hand (METHODS
3.2)."""

from copy import deepcopy

import pytest
import torch
from torch import nn

from pipeline.methods.pointnetvlad.netvlad import Describer, NetVlad, folded


def awake(net: nn.Module) -> nn.Module:
    """With batch norms that have seen something and T-Nets that change the base."""
    generator = torch.Generator().manual_seed(3)
    for name, value in net.state_dict().items():
        if name.endswith("running_var"):
            value.uniform_(0.5, 2, generator=generator)
        elif value.is_floating_point() and (
            "norm" in name or name.endswith("running_mean") or "base.weight" in name
        ):
            value.add_(torch.empty_like(value).uniform_(-0.05, 0.05, generator=generator))
    return net.eval()


@pytest.fixture(scope="module")
def net() -> nn.Module:
    torch.manual_seed(0)
    return awake(Describer())


def test_the_paper_counts_19_784_393_numbers(net: nn.Module) -> None:
    # 1024·64 + 2·64, 1024·64, 65536·256 + 2·256, 256·256 + 2·256
    assert sum(value.numel() for value in net.netvlad.parameters()) == 16_974_976
    assert (
        sum(value.numel() for value in net.parameters())
        == 803_081 + 1_857_344 + 148_992 + 16_974_976
        == 19_784_393
    )


def test_a_descriptor_has_length_one_and_does_not_depend_on_the_order_of_points(
    net: nn.Module,
) -> None:
    clouds = torch.rand(2, 200, 3, generator=torch.Generator().manual_seed(1)) * 2 - 1
    order = torch.randperm(200)
    with torch.inference_mode():
        descriptors = net(clouds)
        other = net(clouds[:, order])
    assert descriptors.shape == (2, 256)
    torch.testing.assert_close(descriptors.norm(dim=1), torch.ones(2))
    torch.testing.assert_close(descriptors, other, atol=1e-5, rtol=0)
    assert float((descriptors[0] - descriptors[1]).norm()) > 1e-2


def test_netvlad_is_its_definition() -> None:
    """METHODS 3.2 point by point, cluster by cluster, in float64."""
    torch.manual_seed(1)
    single = awake(NetVlad(features=6, clusters=3, size=4))
    layer = deepcopy(single).double()
    features = torch.rand(1, 5, 6, dtype=torch.float64)
    unit = features[0] / features[0].norm(dim=1, keepdim=True)
    norm = layer.assign_norm
    logits = (unit @ layer.assign.weight.T - norm.running_mean) / (
        norm.running_var + 1e-3
    ).sqrt() * norm.weight + norm.bias
    share = logits.exp() / logits.exp().sum(1, keepdim=True)
    columns = []
    for k in range(3):
        column = sum(share[i, k] * (unit[i] - layer.centres[:, k]) for i in range(5))
        columns.append(column / column.norm())
    flat = torch.stack(columns, dim=1).flatten()  # (feature, cluster) order
    projected = layer.project_norm(((flat / flat.norm()) @ layer.project.weight.T)[None])
    gated = projected * torch.sigmoid(layer.gate_norm(projected @ layer.gate.weight.T))
    with torch.no_grad():
        torch.testing.assert_close(
            single(features.float()).double(), gated / gated.norm(), atol=1e-6, rtol=0
        )


def test_weights_start_as_the_authors_do() -> None:
    torch.manual_seed(0)
    layer = NetVlad()
    for weight, deviation in (
        (layer.assign.weight, 1 / 32),
        (layer.centres, 1 / 32),
        (layer.project.weight, 1 / 8),
        (layer.gate.weight, 1 / 16),
    ):
        assert float(weight.detach().std()) == pytest.approx(deviation, rel=0.02)


@pytest.mark.parametrize("kind", [torch.float32, torch.bfloat16])
def test_a_folded_network_gives_the_same_descriptors(net: nn.Module, kind: torch.dtype) -> None:
    clouds = torch.rand(2, 300, 3, generator=torch.Generator().manual_seed(2)) * 2 - 1
    before = [value.clone() for value in net.state_dict().values()]
    with torch.inference_mode(), torch.autocast("cpu", kind, enabled=kind == torch.bfloat16):
        fast = folded(net, kind)(clouds)
    with torch.inference_mode():
        torch.testing.assert_close(
            fast, net(clouds), atol={torch.float32: 1e-5, torch.bfloat16: 5e-3}[kind], rtol=0
        )
    assert all(
        torch.equal(one, other)
        for one, other in zip(before, net.state_dict().values(), strict=True)
    )


def test_a_cloud_of_one_spot_has_a_descriptor(net: nn.Module) -> None:
    with torch.inference_mode():
        assert torch.isfinite(net(torch.zeros(1, 16, 3))).all()
