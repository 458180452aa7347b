"""Reads the weights of a user's file into the network (METHODS 3.2).

The file is a model of this method, a safetensors file, or a TensorFlow checkpoint of the authors.
The weights of the latter get this network's names:

- The authors' names are those of `pointnetvlad_cls.py`, `transform_nets.py` and `loupe.py`; the
  scope before a name, such as `query_triplets/`, is ignored.
- Their dense layers are convolutions over single points, so weights are transposed.
- The biases of their last T-Net layers lack the identity, which is added.
- The T-Nets' batch norms keep moving averages, named after the operation that computed the
  statistic; TensorFlow's versions name that operation differently. NetVLAD's batch norms keep
  `moving_mean` and `moving_variance`. The trunk has no batch norms.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file
from torch import nn

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.methods.pointnetvlad.checkpoint import is_checkpoint, read_checkpoint
from pipeline.networks import loop

Arrays = Mapping[str, NDArray[Any]]
AVERAGE = "ExponentialMovingAverage"
"""The end of a moving average's name; before it comes the operation, one of MEAN or VARIANCE."""
MEAN = ("moments/Squeeze/", "moments/normalize/mean/", "moments/mean/")
VARIANCE = ("moments/Squeeze_1/", "moments/normalize/variance/", "moments/variance/")
TNETS = {"turn": ("transform_net1", "transform_XYZ"), "mix": ("transform_net2", "transform_feat")}
"""Our name of each T-Net to the authors' scope, and the scope of its last layer within it. `turn`
is the T-Net of positions, `mix` the T-Net of features."""
TRUNK = {"early": ("conv1", "conv2"), "late": ("conv3", "conv4", "conv5")}
NORMS = {"assign_norm": "cluster_bn", "project_norm": "bn", "gate_norm": "gating_bn"}
MATRICES = {"assign": "cluster_weights", "project": "hidden1_weights", "gate": "gating_weights"}
"""Our names to theirs: of the trunk's layers, and of NetVLAD's batch norms and matrices."""


def load(net: nn.Module, path: Path) -> None:
    """Load the weights of a file into the network.

    In a model and a safetensors file they have the network's own names, with or without net/ before
    them. The path of a checkpoint is the path of its files without `.index` and `.data-…`. Raises
    ConfigError, which names the file and the first tensor that is missing, unknown or of another
    shape.
    """
    stored = _stored(path)
    expected = net.state_dict()
    tensors = loop.tensors(stored) or loop.tensors(stored, "")
    # A file may lack the batch norms' counters.
    counters = {
        name: value for name, value in expected.items() if name.endswith("num_batches_tracked")
    }
    tensors = counters | tensors
    for name in [*expected, *tensors]:
        has = tuple(tensors[name].shape) if name in tensors else "none"
        wants = tuple(expected[name].shape) if name in expected else "none"
        if has != wants:
            raise ConfigError(f"method.weights: {path}: tensor {name} is {has}, expected {wants}")
    net.load_state_dict(tensors)


def _stored(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file of weights, by the network's names; raises ConfigError."""
    if is_checkpoint(path):
        return renamed(read_checkpoint(path))
    try:
        return store.read_model(path) if path.name.endswith(store.MODEL) else load_file(path)
    except ArtifactError as error:
        raise ConfigError(f"{str(error).partition(';')[0]}; correct method.weights") from None
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; correct method.weights") from None
    except (SafetensorError, IsADirectoryError) as error:
        raise ConfigError(
            f"{path}: not a safetensors file ({error}); correct method.weights"
        ) from None


def renamed(tensors: Arrays) -> dict[str, NDArray[np.float32]]:
    """The weights by the network's names, from the authors' tensors by their names.

    Raises ConfigError, which names the tensor, if the checkpoint lacks a tensor.
    """
    return {
        name: np.ascontiguousarray(value, np.float32) for name, value in _collected(tensors).items()
    }


def _collected(tensors: Arrays) -> dict[str, NDArray[Any]]:
    """The weights by our names, still in the authors' number types."""
    arrays: dict[str, NDArray[Any]] = {}
    # The T-Nets.
    for ours, (scope, last_scope) in TNETS.items():
        layers = [(f"points.{2 * i}", f"tconv{i + 1}") for i in range(3)]
        layers += [(f"cloud.{2 * i}", f"tfc{i + 1}") for i in range(2)]
        for layer, their_layer in layers:
            prefix = f"pointnet.{ours}.{layer}"
            arrays |= _dense(tensors, f"{prefix}.0", f"{scope}/{their_layer}")
            arrays |= _averaged_norm(tensors, f"{prefix}.1", f"{scope}/{their_layer}/bn")
        base = _dense(tensors, f"pointnet.{ours}.base", f"{scope}/{last_scope}")
        bias_key = f"pointnet.{ours}.base.bias"
        base[bias_key] = base[bias_key] + np.eye(round(len(base[bias_key]) ** 0.5)).ravel()
        arrays |= base
    # The trunk.
    for ours, scopes in TRUNK.items():
        for i, scope in enumerate(scopes):
            arrays |= _dense(tensors, f"pointnet.{ours}.{2 * i}", scope)
    # NetVLAD.
    for ours, scope in MATRICES.items():
        arrays[f"netvlad.{ours}.weight"] = _tensor(tensors, scope).T
    arrays["netvlad.centres"] = _tensor(tensors, "cluster_weights2")[0]
    for ours, scope in NORMS.items():
        for name, suffix in (
            ("weight", "gamma"),
            ("bias", "beta"),
            ("running_mean", "moving_mean"),
            ("running_var", "moving_variance"),
        ):
            arrays[f"netvlad.{ours}.{name}"] = _tensor(tensors, f"{scope}/{suffix}")
    return arrays


def _dense(tensors: Arrays, prefix: str, scope: str) -> dict[str, NDArray[Any]]:
    """The weights (output, input) and biases of a layer, from the authors' (…, input, output)."""
    weights = _tensor(tensors, f"{scope}/weights")
    return {
        f"{prefix}.weight": weights.reshape(-1, weights.shape[-1]).T,
        f"{prefix}.bias": _tensor(tensors, f"{scope}/biases"),
    }


def _averaged_norm(tensors: Arrays, prefix: str, scope: str) -> dict[str, NDArray[Any]]:
    """A batch norm of a T-Net, whose statistics are moving averages."""
    return {
        f"{prefix}.weight": _tensor(tensors, f"{scope}/gamma"),
        f"{prefix}.bias": _tensor(tensors, f"{scope}/beta"),
        f"{prefix}.running_mean": _tensor(tensors, *(f"{scope}/{end}{AVERAGE}" for end in MEAN)),
        f"{prefix}.running_var": _tensor(tensors, *(f"{scope}/{end}{AVERAGE}" for end in VARIANCE)),
    }


def _tensor(tensors: Arrays, *endings: str) -> NDArray[Any]:
    """The tensor whose name has one of these endings; of several names the shortest."""
    for ending in endings:
        names = [name for name in tensors if f"/{name}".endswith(f"/{ending}")]
        if names:
            return tensors[min(names, key=len)]
    raise ConfigError(
        f"method.weights: no tensor …/{endings[0]}; a checkpoint of PointNetVLAD's authors has one"
    )
