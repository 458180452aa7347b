"""NetVLAD with context gating over the features of a cloud's points (METHODS 3.2).

Arandjelović et al., CVPR 2016; gating: Miech et al., 2017; as put together by Uy and Lee, CVPR
2018.
"""

from copy import deepcopy

import torch
from torch import Tensor, nn
from torch.nn.functional import normalize
from torch.nn.utils.fusion import fuse_linear_bn_eval

from pipeline.methods.pointnetvlad.pointnet import EPS, PointNet


class NetVlad(nn.Module):
    """A descriptor (cloud, size) of length 1 of features (cloud, point, features), whatever the
    points' order.

    16,974,976 trained numbers.
    """

    def __init__(
        self, features: int = 1024, clusters: int = 64, size: int = 256, momentum: float = 0.1
    ) -> None:
        super().__init__()
        self.assign = nn.Linear(features, clusters, bias=False)
        self.assign_norm = nn.BatchNorm1d(clusters, eps=EPS, momentum=momentum)
        self.centres = nn.Parameter(torch.empty(features, clusters))
        self.project = nn.Linear(features * clusters, size, bias=False)
        self.project_norm = nn.BatchNorm1d(size, eps=EPS, momentum=momentum)
        self.gate = nn.Linear(size, size, bias=False)
        self.gate_norm = nn.BatchNorm1d(size, eps=EPS, momentum=momentum)
        layers = (self.assign.weight, self.centres, self.project.weight, self.gate.weight)
        for weight, inputs in zip(layers, (features, features, clusters, size), strict=True):
            nn.init.normal_(weight, std=inputs**-0.5)

    def forward(self, features: Tensor) -> Tensor:
        lengths = torch.linalg.vector_norm(features, dim=2, keepdim=True).float()
        scale = 1 / lengths.clamp_min(1e-6)  # cheaper than to scale the features themselves
        likeness = (self.assign(features) * scale).flatten(0, 1)
        share = self.assign_norm(likeness).softmax(1).unflatten(0, features.shape[:2])
        summed = (share * scale).to(features.dtype).transpose(
            1, 2
        ) @ features  # (cloud, cluster, features)
        residual = summed.transpose(1, 2) - share.sum(1, keepdim=True) * self.centres
        vlad = normalize(normalize(residual.float(), dim=1).flatten(1))
        projected = self.project_norm(self.project(vlad).float())
        return normalize(projected * self.gate_norm(self.gate(projected).float()).sigmoid())


class Describer(nn.Module):
    """The whole network, 19,784,393 trained numbers: descriptors (cloud, size) of clouds (cloud,
    point, xyz).

    `momentum` is the weight of a new batch in the statistics of all batch norms; the authors' is
    .001 here and, in the TNets, .5 falling to .01.
    """

    def __init__(
        self, features: int = 1024, clusters: int = 64, size: int = 256, momentum: float = 0.1
    ) -> None:
        super().__init__()
        self.pointnet = PointNet(features, momentum)
        self.netvlad = NetVlad(features, clusters, size, momentum)

    def forward(self, clouds: Tensor) -> Tensor:
        descriptors: Tensor = self.netvlad(self.pointnet(clouds))
        return descriptors

    def steps(self) -> int:
        """How many batches it was trained on."""
        seen = self.netvlad.gate_norm.num_batches_tracked
        return 0 if seen is None else int(seen)


def folded(net: nn.Module, kind: torch.dtype = torch.float32) -> nn.Module:
    """A copy for descriptions alone, several times faster: batch norms folded into the dense layers
    before them, and the dense layers' weights of this kind; with bfloat16 it must run under
    autocast."""
    net = deepcopy(net).eval()
    for parent in list(net.modules()):
        for name, pair in parent.named_children():
            if isinstance(pair, nn.Sequential) and [type(layer) for layer in pair] == [
                nn.Linear,
                nn.BatchNorm1d,
            ]:
                setattr(parent, name, fuse_linear_bn_eval(*pair))
    for layer in net.modules():
        if isinstance(layer, nn.Linear):
            layer.to(kind)
    return net
