"""Reads a file of weights that a user names into the network (METHODS 3.2).

The file is a model of this method, a safetensors file, or a TensorFlow checkpoint of the authors.
"""

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
    """Load the weights of a file into the network.

    In a model and a safetensors file they have the network's own names, with or without net/ before
    them. The path of a checkpoint is that of its files without `.index` and `.data-…`. Raises
    ConfigError that names the file and the first tensor that is missing, unknown or of another
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
    """The arrays of a file of weights, by the network's names.

    Raises ConfigError for a file that is missing or of none of the three kinds.
    """
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
