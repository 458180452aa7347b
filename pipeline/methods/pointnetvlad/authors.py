"""The weights of PointNetVLAD's authors under this network's names (METHODS 3.2).

Their names are those of `pointnetvlad_cls.py`, `transform_nets.py` and `loupe.py`, below any scope,
such as `query_triplets/`. A dense layer is a convolution of one point there, its weights
transposed; the T-Nets' last biases are the difference from the identity.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError

Arrays = Mapping[str, NDArray[Any]]
AVERAGE = "ExponentialMovingAverage"
MEAN = ("moments/Squeeze/", "moments/normalize/mean/", "moments/mean/")
VARIANCE = ("moments/Squeeze_1/", "moments/normalize/variance/", "moments/variance/")
TNETS = {"turn": ("transform_net1", "transform_XYZ"), "mix": ("transform_net2", "transform_feat")}
TRUNK = {"early": ("conv1", "conv2"), "late": ("conv3", "conv4", "conv5")}
NORMS = {"assign_norm": "cluster_bn", "project_norm": "bn", "gate_norm": "gating_bn"}
MATRICES = {"assign": "cluster_weights", "project": "hidden1_weights", "gate": "gating_weights"}


def renamed(tensors: Arrays) -> dict[str, NDArray[np.float32]]:
    """The weights of the network by their names here.

    Raises ConfigError naming a tensor that the checkpoint lacks.
    """
    return {
        name: np.ascontiguousarray(value, np.float32) for name, value in _named(tensors).items()
    }


def _named(tensors: Arrays) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    for ours, (theirs, last) in TNETS.items():
        layers = [(f"points.{2 * i}", f"tconv{i + 1}") for i in range(3)]
        layers += [(f"cloud.{2 * i}", f"tfc{i + 1}") for i in range(2)]
        for layer, scope in layers:
            place = f"pointnet.{ours}.{layer}"
            arrays |= _dense(tensors, f"{place}.0", f"{theirs}/{scope}")
            arrays |= _moving(tensors, f"{place}.1", f"{theirs}/{scope}/bn")
        base = _dense(tensors, f"pointnet.{ours}.base", f"{theirs}/{last}")
        bias = base[f"pointnet.{ours}.base.bias"]
        base[f"pointnet.{ours}.base.bias"] = bias + np.eye(round(len(bias) ** 0.5)).ravel()
        arrays |= base
    for ours, scopes in TRUNK.items():
        for i, scope in enumerate(scopes):
            arrays |= _dense(tensors, f"pointnet.{ours}.{2 * i}", scope)
    for ours, scope in MATRICES.items():
        arrays[f"netvlad.{ours}.weight"] = _tensor(tensors, scope).T
    arrays["netvlad.centres"] = _tensor(tensors, "cluster_weights2")[0]
    for ours, scope in NORMS.items():
        for name, theirs in (
            ("weight", "gamma"),
            ("bias", "beta"),
            ("running_mean", "moving_mean"),
            ("running_var", "moving_variance"),
        ):
            arrays[f"netvlad.{ours}.{name}"] = _tensor(tensors, f"{scope}/{theirs}")
    return arrays


def _dense(tensors: Arrays, place: str, scope: str) -> dict[str, NDArray[Any]]:
    weights = _tensor(tensors, f"{scope}/weights")
    return {
        f"{place}.weight": weights.reshape(-1, weights.shape[-1]).T,
        f"{place}.bias": _tensor(tensors, f"{scope}/biases"),
    }


def _moving(tensors: Arrays, place: str, scope: str) -> dict[str, NDArray[Any]]:
    """A batch norm whose statistics are moving averages, named by where they were computed."""
    return {
        f"{place}.weight": _tensor(tensors, f"{scope}/gamma"),
        f"{place}.bias": _tensor(tensors, f"{scope}/beta"),
        f"{place}.running_mean": _tensor(tensors, *(f"{scope}/{end}{AVERAGE}" for end in MEAN)),
        f"{place}.running_var": _tensor(tensors, *(f"{scope}/{end}{AVERAGE}" for end in VARIANCE)),
    }


def _tensor(tensors: Arrays, *endings: str) -> NDArray[Any]:
    """The tensor whose name ends in one of these words; what an optimizer keeps ends in others."""
    for ending in endings:
        names = [name for name in tensors if f"/{name}".endswith(f"/{ending}")]
        if names:
            return tensors[min(names, key=len)]
    raise ConfigError(
        f"method.weights: no tensor …/{endings[0]}; a checkpoint of PointNetVLAD's authors has one"
    )
