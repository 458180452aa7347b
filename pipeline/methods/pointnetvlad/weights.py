"""Weights that a user brings: a safetensors file read into the network (METHODS 3.2)."""

from pathlib import Path

from torch import nn

from pipeline import store
from pipeline.errors import ArtifactError, ConfigError
from pipeline.networks import loop


def load(net: nn.Module, path: Path) -> None:
    """Read tensors under the network's own names, with or without net/ before them.

    Raises ConfigError naming the file and the first tensor that is missing, unknown or of another
    shape.
    """
    try:
        stored = store.read_foreign_model(path)
    except ArtifactError as error:
        raise ConfigError(f"{str(error).partition(';')[0]}; correct method.weights") from None
    weights = net.state_dict()
    tensors = loop.tensors(stored) or loop.tensors(stored, "")
    tensors = {
        name: value for name, value in weights.items() if name.endswith("num_batches_tracked")
    } | tensors
    for name in [*weights, *tensors]:
        if name not in weights or name not in tensors or tensors[name].shape != weights[name].shape:
            has, wants = (
                tuple(part[name].shape) if name in part else "none" for part in (tensors, weights)
            )
            raise ConfigError(f"method.weights: {path}: tensor {name} is {has}, expected {wants}")
    net.load_state_dict(tensors)
