"""Weights that a user brings, read into the network (METHODS 3.2)."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file
from torch import nn

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.methods.pointnetvlad.authors import renamed
from pipeline.methods.pointnetvlad.checkpoint import is_checkpoint, read_checkpoint
from pipeline.networks import loop


def load(net: nn.Module, path: Path) -> None:
    """Read tensors of a model or a safetensors file under the network's own names.

    They may have net/ before them. Or those of a TensorFlow checkpoint of the authors, whose path
    is that of its files without `.index` and `.data-…`.

    Raises ConfigError naming the file and the first tensor that is missing, unknown or of another
    shape.
    """
    stored = _stored(path)
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


def _stored(path: Path) -> dict[str, NDArray[Any]]:
    """The named arrays of a model of ours, of a safetensors file or of the authors' checkpoint."""
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
