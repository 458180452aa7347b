"""Reads and writes site files: a zip of site.json, model.safetensors and map.safetensors.

A site that can be updated also has views.safetensors, an exported site also network.onnx. Reading a
file runs no code from it, and unpacks nothing to disk.
"""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load, save

from pipeline.core.errors import ArtifactError, ConfigError, YearlocError
from pipeline.core.replacing import replace as replaced
from pipeline.core.settings import filled, plain
from pipeline.online.runtime import NETWORK
from pipeline.online.site_json import VERSION, LevelDescription, SiteDescription

ABOUT = "site.json"
MODEL = "model.safetensors"
MAP = "map.safetensors"
VIEWS = "views.safetensors"
REQUIRED = {ABOUT, MODEL, MAP}
OPTIONAL = {VIEWS, NETWORK}
LARGEST_BYTES = 2**32
"""A file that would unpack to more bytes is refused."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the zip, so that equal sites have equal bytes."""
Arrays = Mapping[str, NDArray[Any]]
"""Arrays by name."""


class Parts(NamedTuple):
    """The content of a site file."""

    description: SiteDescription
    """The content of site.json."""
    model: Arrays
    """The arrays that the method learned."""
    arrays: Arrays
    """The map, the cells of the places, and the expected features (posing/expectations.py)."""
    network: bytes | None
    """The network as an ONNX file; `model` has no weights then. None if it was not exported."""
    views: Arrays = MappingProxyType({})
    """The views that the model learned from, and its answers to validation views (pack.py). They
    are read only on request."""


class LevelParts(NamedTuple):
    """The content of a level site's file."""

    description: LevelDescription
    """The content of site.json."""
    arrays: Arrays
    """The map: `occupancy` (row, col) in percent, −1 where unknown, row 0 the lowest."""


def write(path: Path, parts: Parts | LevelParts) -> None:
    """Write a site file, whole or not at all."""
    description = {"version": VERSION, **plain(parts.description, whole=True)}
    about = json.dumps(description, indent=1, allow_nan=False)
    content = {ABOUT: about.encode()}
    if isinstance(parts, LevelParts):
        content[MODEL] = _saved({})
        content[MAP] = _saved(parts.arrays)
    else:
        content[MODEL] = _saved(parts.model)
        content[MAP] = _saved(parts.arrays)
        if parts.views:
            content[VIEWS] = _saved(parts.views)
        if parts.network is not None:
            content[NETWORK] = parts.network
    with replaced(path) as scratch, zipfile.ZipFile(scratch, "w") as file:
        for name, data in content.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED, 6)


def _saved(arrays: Arrays) -> bytes:
    """The arrays as the bytes of a safetensors file."""
    contiguous = {key: np.require(array, requirements="C") for key, array in arrays.items()}
    return bytes(save(contiguous))


def read(path: Path, views: bool = False) -> Parts:
    """Read a site of 3-D scans, with its views if `views`.

    Raises ArtifactError for a file that is not whole or of another version, and for a level site.
    """
    parts = read_either(path, views)
    if isinstance(parts, LevelParts):
        raise ArtifactError(
            f"{path}: a level site, of a 2-D laser; this works with sites of 3-D scans alone"
        )
    return parts


def read_either(path: Path, views: bool = False) -> Parts | LevelParts:
    """Read a site of 3-D scans or a level site, with its views if `views`.

    Raises ArtifactError for a file that is not whole or of another version.
    """
    if path.suffix == ".onnx":
        raise ArtifactError(
            f"{path}: a network alone; `yearloc export SITE -o FILE.site` writes a site that "
            "answers with it"
        )
    try:
        with zipfile.ZipFile(path) as file:
            _check_entries(path, file)
            names = [name for name in file.namelist() if views or name != VIEWS]
            content = {name: file.read(name) for name in names}
        about = json.loads(content[ABOUT])
        model = load(content[MODEL])
        arrays = load(content[MAP])
        view_arrays = load(content[VIEWS]) if VIEWS in content else {}
    except FileNotFoundError:
        raise ArtifactError(
            f"{path}: no such site; `yearloc pack STUDY/GRID/METHOD -o {path.name}` writes one"
        ) from None
    except IsADirectoryError:
        raise ArtifactError(f"{path}: a folder, expected a site file") from None
    except YearlocError:
        raise
    # zipfile, zlib, json and safetensors raise errors of many classes for a damaged file
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise ArtifactError(f"{path}: no whole site ({reason}); copy or pack it again") from None
    if not isinstance(about, dict) or about.get("version") != VERSION:
        version = about.get("version") if isinstance(about, dict) else None
        raise ArtifactError(
            f"{path}: a site of version {version}, this yearloc reads version {VERSION}; pack it "
            "again"
        )
    try:
        if "level" in about:
            return LevelParts(filled(LevelDescription, about), arrays)
        description = filled(SiteDescription, about)
    except ConfigError as error:
        raise ArtifactError(f"{path}: its {ABOUT}: {error}; pack the site again") from None
    return Parts(description, model, arrays, content.get(NETWORK), view_arrays)


def _check_entries(path: Path, file: zipfile.ZipFile) -> None:
    """Raise ArtifactError for a zip that lacks files of a site, has others, or is too large."""
    names = file.namelist()
    has_parts = set(names) - OPTIONAL == REQUIRED
    if not has_parts or len(names) != len(set(names)):
        unexpected = [name for name in names if name not in REQUIRED | OPTIONAL]
        problem = f"holds {unexpected[0][:60]!r}" if unexpected else "lacks a part"
        raise ArtifactError(f"{path}: no site, it {problem}; expected {ABOUT}, {MODEL} and {MAP}")
    size = sum(entry.file_size for entry in file.infolist())
    if size > LARGEST_BYTES:
        raise ArtifactError(f"{path}: unpacks to {size:,} bytes, more than a site has")
