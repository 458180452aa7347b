"""PointNet's trunk as PointNetVLAD uses it: a feature of each point of a cloud (METHODS 3.2).

Every point goes through the same dense layers by itself. Two small networks, the T-Nets, compute a
change of base from all points of the cloud: one for the positions, one for the features. PointNet
is by Qi et al., CVPR 2017; as in the code of Uy and Lee, CVPR 2018, the trunk has no batch norm and
no pooling.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

EPS = 1e-3
"""What every batch norm adds to the variance, as in TensorFlow."""


def dense(*widths: int, momentum: float | None = None) -> nn.Sequential:
    """Dense layers from each width to the next, with a ReLU after each.

    If a momentum is given, there is a batch norm before each ReLU.
    """
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layer = nn.Linear(inputs, outputs)
        nn.init.xavier_uniform_(layer.weight)
        nn.init.zeros_(layer.bias)
        if momentum is None:
            layers.append(layer)
        else:
            norm = nn.BatchNorm1d(outputs, eps=EPS, momentum=momentum)
            layers.append(nn.Sequential(layer, norm))
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


class TNet(nn.Module):
    """A change of base (cloud, width, width) for points (cloud, point, width).

    It is the identity before training. `momentum` is the weight of a new batch in the batch norms'
    running statistics. It has 803,081 trained numbers for a width of 3, 1,857,344 for 64.
    """

    def __init__(self, width: int, momentum: float) -> None:
        super().__init__()
        self.points = dense(width, 64, 128, 1024, momentum=momentum)[:-1]
        self.cloud = dense(1024, 512, 256, momentum=momentum)
        self.base = nn.Linear(256, width * width)
        nn.init.zeros_(self.base.weight)
        self.base.bias.data = torch.eye(width).flatten()

    def forward(self, points: Tensor) -> Tensor:
        cloud_count, point_count, width = points.shape
        features = self.points(points.flatten(0, 1)).unflatten(0, (cloud_count, point_count))
        # Both compute the same maximum; `max` is faster with a backward pass, `amax` without.
        highest = features.max(1).values if self.training else features.amax(1)
        # The ReLU comes after the maximum, which gives the same numbers with less work.
        base: Tensor = self.base(self.cloud(highest.relu()))
        return base.view(cloud_count, width, width)


class PointNet(nn.Module):
    """Features (cloud, point, features) of all points of clouds (cloud, point, xyz).

    It has 148,992 trained numbers beside those of two T-Nets.
    """

    def __init__(self, features: int = 1024, momentum: float = 0.1) -> None:
        super().__init__()
        self.turn = TNet(3, momentum)
        self.early = dense(3, 64, 64)
        self.mix = TNet(64, momentum)
        self.late = dense(64, 64, 128, features)

    def forward(self, clouds: Tensor) -> Tensor:
        early = self.early(clouds @ self.turn(clouds))
        late: Tensor = self.late(early @ self.mix(early))
        return late
