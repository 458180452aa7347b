"""Tests of PointNet's trunk: its numbers are counted (METHODS 3.2), and it starts without changing
any base."""

import pytest
import torch

from pipeline.methods.pointnetvlad.pointnet import PointNet, TNet


def count(*modules: torch.nn.Module) -> int:
    return sum(value.numel() for module in modules for value in module.parameters())


def test_the_paper_counts_the_numbers_of_each_part() -> None:
    # TNet of width 3: 3·64+64, 64·128+128, 128·1024+1024, 1024·512+512, 512·256+256, two a channel
    # for five batch norms, 256·9+9.
    net = PointNet()
    assert count(net.turn) == 803_081
    assert count(net.mix) == 1_857_344
    # 3·64+64, 64·64+64, 64·64+64, 64·128+128, 128·1024+1024
    assert count(net.early, net.late) == 148_992


@pytest.mark.parametrize("width", [3, 64])
@pytest.mark.parametrize("training", [True, False])
def test_a_change_of_base_is_the_identity_before_training(width: int, training: bool) -> None:
    bases = TNet(width, 0.1).train(training)(torch.rand(3, 20, width))
    assert torch.equal(bases, torch.eye(width).expand(3, width, width))


def test_points_are_multiplied_on_the_right_by_the_base() -> None:
    net = PointNet(16).eval()
    seen: list[torch.Tensor] = []
    net.early.register_forward_hook(lambda module, inputs, output: seen.append(inputs[0]))
    with torch.no_grad():
        net.turn.base.bias.copy_(torch.tensor([0.0, 1, 0, 0, 0, 2, 3, 0, 0]))
        net(torch.tensor([[[1.0, 10, 100]]]))
    # (1, 10, 100) · [[0, 1, 0], [0, 0, 2], [3, 0, 0]] = (300, 1, 20)
    assert seen[0].tolist() == [[[300, 1, 20]]]


def test_a_point_has_its_feature_wherever_it_stands_in_the_cloud() -> None:
    torch.manual_seed(0)
    net = PointNet(32).eval()
    clouds = torch.rand(2, 30, 3)
    torch.nn.init.normal_(net.mix.base.weight, std=0.1)
    order = torch.randperm(30)
    with torch.no_grad():
        torch.testing.assert_close(net(clouds)[:, order], net(clouds[:, order]))


def test_the_base_is_found_from_the_highest_of_all_points_in_training_as_in_inference() -> None:
    torch.manual_seed(0)
    net = TNet(3, 0.1)
    torch.nn.init.normal_(net.base.weight)
    clouds = torch.rand(4, 9, 3)
    points = net.points(clouds.flatten(0, 1)).unflatten(0, (4, 9)).relu()
    by_hand = net.base(net.cloud(points.amax(1))).unflatten(1, (3, 3))
    torch.testing.assert_close(net(clouds), by_hand)
