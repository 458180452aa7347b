"""NetVLAD with context gating: one descriptor from the features of a cloud's points (METHODS 3.2).

1. Assign each point's feature softly to clusters.
2. Sum the residuals from each cluster's centre, and normalise the sums.
3. Project the sums to one short vector.
4. Gate each of its numbers by the vector itself, and normalise.

NetVLAD is by Arandjelović et al., CVPR 2016, gating by Miech et al., 2017. `Describer` is the
network of Uy and Lee, CVPR 2018, which puts both behind PointNet.
"""

from copy import deepcopy

import torch
from torch import Tensor, nn
from torch.nn.functional import normalize
from torch.nn.utils.fusion import fuse_linear_bn_eval

from pipeline.methods.pointnetvlad.pointnet import EPS, PointNet


class NetVlad(nn.Module):
    """Descriptors (cloud, size) of length 1 from features (cloud, point, features).

    They do not depend on the order of the points. It has 16,974,976 trained numbers.
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
        # Assign features of length 1 to clusters. It is cheaper to scale the results than the
        # features.
        lengths = torch.linalg.vector_norm(features, dim=2, keepdim=True).float()
        scale = 1 / lengths.clamp_min(1e-6)
        cluster_logits = (self.assign(features) * scale).flatten(0, 1)
        share = self.assign_norm(cluster_logits).softmax(1).unflatten(0, features.shape[:2])
        # Residuals from the centres, (cloud, features, cluster).
        scaled_share = (share * scale).to(features.dtype)
        summed = scaled_share.transpose(1, 2) @ features  # (cloud, cluster, features)
        residual = summed.transpose(1, 2) - share.sum(1, keepdim=True) * self.centres
        vlad = normalize(normalize(residual.float(), dim=1).flatten(1))
        # Projection and gate.
        projected = self.project_norm(self.project(vlad).float())
        gate = self.gate_norm(self.gate(projected).float()).sigmoid()
        return normalize(projected * gate)


class Describer(nn.Module):
    """The whole network: descriptors (cloud, size) of clouds (cloud, point, xyz).

    It has 19,784,393 trained numbers. `momentum` is the weight of a new batch in the running
    statistics of all batch norms; the authors' is .001 in NetVLAD, and .5 falling to .01 in the
    T-Nets.
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
        """The number of batches that it was trained on."""
        seen = self.netvlad.gate_norm.num_batches_tracked
        return 0 if seen is None else int(seen)


def folded(net: nn.Module, weight_type: torch.dtype = torch.float32) -> nn.Module:
    """A copy of a network that is several times faster, but cannot be trained.

    Its batch norms are folded into the dense layers before them, whose weights get this type; with
    bfloat16 the network must run under autocast.
    """
    net = deepcopy(net).eval()
    for parent in list(net.modules()):
        for name, child in parent.named_children():
            if not isinstance(child, nn.Sequential):
                continue
            if [type(layer) for layer in child] == [nn.Linear, nn.BatchNorm1d]:
                setattr(parent, name, fuse_linear_bn_eval(*child))
    for layer in net.modules():
        if isinstance(layer, nn.Linear):
            layer.to(weight_type)
    return net
