"""Models on disk: named arrays and a recipe in one safetensors file.

The recipe holds a checksum of both.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from pipeline.errors import ArtifactError
from pipeline.replacing import replace
from pipeline.sealed import REBUILD, SEAL

RECIPE = "recipe"
"""The one key of a model's metadata (safetensors writes several in random order)."""


def write_model(
    path: str | Path, model: Mapping[str, NDArray[Any]], recipe: Mapping[str, object]
) -> None:
    """Write named arrays as one safetensors file, with their recipe as its metadata.

    The recipe is the parameters that they were learned with.
    """
    with replace(path) as scratch:
        arrays = {name: np.require(array, requirements="C") for name, array in model.items()}
        words = {name: str(value) for name, value in recipe.items()}
        words[SEAL] = _recipe_checksum(words) + _arrays_checksum(arrays)
        try:
            save_file(arrays, scratch, {RECIPE: json.dumps(words)})
        except SafetensorError as error:
            raise ArtifactError(f"{path}: cannot be written ({error})") from None


def read_recipe(path: str | Path) -> dict[str, str]:
    """Read the parameters that a model was learned with."""
    with _model(path) as file:
        recipe = _recipe(file)
    _compare(path, recipe, 0, _recipe_checksum(recipe))
    return {name: value for name, value in recipe.items() if name != SEAL}


def read_model(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a model's named arrays; raises ArtifactError if the file is missing or damaged."""
    with _model(path) as file:
        arrays = _arrays(file)
        recipe = _recipe(file)
    _compare(path, recipe, 8, _arrays_checksum(arrays))
    return arrays


def read_foreign_model(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read the named arrays of a safetensors file that `write_model` did not write.

    Raises ArtifactError if it is none.
    """
    with _model(path) as file:
        return _arrays(file)


def _compare(path: str | Path, recipe: Mapping[str, str], start: int, checksum: str) -> None:
    if recipe.get(SEAL, "")[start : start + 8] != checksum:
        raise ArtifactError(f"{path}: its numbers are not as they were written; {REBUILD}")


def _arrays(file: Any) -> dict[str, NDArray[Any]]:
    return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)


def _recipe(file: Any) -> dict[str, str]:
    try:
        recipe: dict[str, str] = json.loads((file.metadata() or {}).get(RECIPE, "{}"))
    except ValueError:
        return {}
    return recipe


@contextmanager
def _model(path: str | Path) -> Iterator[Any]:
    try:
        with safe_open(path, "numpy") as file:
            yield file
    except FileNotFoundError:
        raise ArtifactError(f"{path}: no such model; `dvc repro` trains it") from None
    except IsADirectoryError:
        raise ArtifactError(f"{path}: a folder, expected a safetensors file") from None
    except SafetensorError as error:
        raise ArtifactError(f"{path}: not a safetensors file ({error}); {REBUILD}") from None


def _recipe_checksum(recipe: Mapping[str, str]) -> str:
    """The checksum of a model's recipe."""
    words = {name: recipe[name] for name in sorted(recipe) if name != SEAL}
    return f"{crc32(json.dumps(words).encode()):08x}"


def _arrays_checksum(model: Mapping[str, NDArray[Any]]) -> str:
    """The checksum of a model's arrays."""
    checksum = 0
    for name in sorted(model):
        array = np.ascontiguousarray(model[name])
        checksum = crc32(f"{name}{array.dtype}{array.shape}".encode(), checksum)
        checksum = (
            crc32(array.reshape(-1).view(np.uint8).data, checksum) if array.size else checksum
        )
    return f"{checksum:08x}"
