"""PointNet's trunk as PointNetVLAD uses it: each point by itself, after two learned changes of base
(METHODS 3.2).

Qi et al., CVPR 2017; Uy and Lee, CVPR 2018. As in the latter's own code the trunk has no batch norm
and no pooling.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

EPS = 1e-3
"""Of every batch norm, as in TensorFlow."""


def dense(*widths: int, momentum: float | None = None) -> nn.Sequential:
    """Dense layers from each width to the next, with a ReLU after each.

    With a momentum, a batch norm between the two.
    """
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layer = nn.Linear(inputs, outputs)
        nn.init.xavier_uniform_(layer.weight)
        nn.init.zeros_(layer.bias)
        without_norm = momentum is None
        layers.append(
            layer
            if without_norm
            else nn.Sequential(layer, nn.BatchNorm1d(outputs, eps=EPS, momentum=momentum))
        )
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


class TNet(nn.Module):
    """A change of base (cloud, width, width) of points (cloud, point, width): the identity before
    training.

    `momentum` is the weight of a new batch in the batch norms' running statistics. 803,081 trained
    numbers for a width of 3, 1,857,344 for 64.
    """

    def __init__(self, width: int, momentum: float) -> None:
        super().__init__()
        self.points = dense(width, 64, 128, 1024, momentum=momentum)[:-1]
        self.cloud = dense(1024, 512, 256, momentum=momentum)
        self.base = nn.Linear(256, width * width)
        nn.init.zeros_(self.base.weight)
        self.base.bias.data = torch.eye(width).flatten()

    def forward(self, points: Tensor) -> Tensor:
        clouds, number, width = points.shape
        features = self.points(points.flatten(0, 1)).unflatten(0, (clouds, number))
        highest = (
            features.max(1).values if self.training else features.amax(1)
        )  # one is faster backwards, the other forwards
        base: Tensor = self.base(
            self.cloud(highest.relu())
        )  # the highest of the ReLUs is the ReLU of the highest
        return base.view(clouds, width, width)


class PointNet(nn.Module):
    """A feature (cloud, point, features) of every point of clouds (cloud, point, xyz): 148,992
    numbers and two TNets."""

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
