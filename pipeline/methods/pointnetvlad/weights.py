"""Weights that a user brings: a safetensors file read into the network (METHODS 3.2)."""

from pathlib import Path

import torch
from torch import nn

from pipeline import store
from pipeline.errors import ArtifactError, ConfigError

NET = "net/"
"""Prefix of the network's tensors in a model."""


def load(net: nn.Module, path: Path) -> None:
    """Read tensors under the network's own names, with or without NET before them.

    Raises ConfigError naming the file and the first tensor that is missing, unknown or of another shape.
    """
    try:
        tensors = store.read_model(path)
    except ArtifactError as error:
        raise ConfigError(f"{str(error).partition(';')[0]}; correct method.weights") from None
    own = net.state_dict()
    if any(name.startswith(NET) for name in tensors):
        tensors = {name: value for name, value in tensors.items() if name.startswith(NET)}
    found = {name.removeprefix(NET): torch.from_numpy(value.copy()) for name, value in tensors.items()}
    found = {name: value for name, value in own.items() if name.endswith("num_batches_tracked")} | found
    for name in [*own, *found]:
        if name not in own or name not in found or found[name].shape != own[name].shape:
            has, wants = (tuple(part[name].shape) if name in part else "none" for part in (found, own))
            raise ConfigError(f"method.weights: {path}: tensor {name} is {has}, expected {wants}")
    net.load_state_dict(found)
