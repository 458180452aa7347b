"""The site file: a zip of site.json, model.safetensors and map.safetensors.

It also holds views.safetensors, by which the site can grow, or network.onnx, where it was exported.
Reading it runs nothing and unpacks nothing to disk.
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
from pipeline.online.runtime import NETWORK
from pipeline.online.site_json import VERSION, LevelDescription, SiteDescription

ABOUT = "site.json"
MODEL = "model.safetensors"
MAP = "map.safetensors"
VIEWS = "views.safetensors"
LARGEST_BYTES = 2**32
EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file in the zip: the same site has the same bytes
Arrays = Mapping[str, NDArray[Any]]


class Parts(NamedTuple):
    """The content of a site file."""

    description: SiteDescription
    """The content of site.json."""
    model: Arrays
    """The arrays that the method learned."""
    arrays: Arrays
    """The map, the cells of the places, and what is expected of fixes (Expectations)."""
    network: bytes | None
    """Exported to ONNX, in place of weights in `model`."""
    views: Arrays = MappingProxyType({})
    """The views that the model learned from, and its answers to held-out ones; read only where
    they are asked for."""


class LevelParts(NamedTuple):
    """The content of a level site's file."""

    description: LevelDescription
    arrays: Arrays
    """The map: `occupancy` (row, col) in percent, −1 where unknown, row 0 the lowest."""


def write(path: Path, parts: Parts | LevelParts) -> None:
    """Write a site file, whole or not at all; with an exported network, `model` has no weights."""
    if isinstance(parts, LevelParts):
        parts_model: Arrays = {}
        views: Arrays = {}
        network = None
    else:
        parts_model = parts.model
        views = parts.views
        network = parts.network
    arrays_by_file = {MODEL: parts_model, MAP: parts.arrays} | ({VIEWS: views} if views else {})
    content = {ABOUT: json.dumps(parts.description.as_json(), indent=1, allow_nan=False).encode()}
    content |= {
        name: save({key: np.require(array, requirements="C") for key, array in part.items()})
        for name, part in arrays_by_file.items()
    }
    content |= {} if network is None else {NETWORK: network}
    with replaced(path) as scratch, zipfile.ZipFile(scratch, "w") as file:
        for name, data in content.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED, 6)


def read(path: Path, views: bool = False) -> Parts:
    """Read a site of 3-D scans, its views only if asked for.

    Raises ArtifactError as `Site.open` does, and for a level site.
    """
    parts = read_either(path, views)
    if isinstance(parts, LevelParts):
        raise ArtifactError(
            f"{path}: a level site, of a 2-D laser; this works with sites of 3-D scans alone"
        )
    return parts


def read_either(path: Path, views: bool = False) -> Parts | LevelParts:
    """Read a site or a level site, its views only if asked for."""
    if path.suffix == ".onnx":
        raise ArtifactError(
            f"{path}: a network alone; `yearloc export SITE -o FILE.site` writes a site that "
            "answers with it"
        )
    try:
        with zipfile.ZipFile(path) as file:
            entries = {entry.filename: entry.file_size for entry in file.infolist()}
            has_parts = set(entries) - {NETWORK, VIEWS} == {ABOUT, MODEL, MAP}
            if not has_parts or len(file.infolist()) != len(entries):
                unexpected = next(
                    (name for name in entries if name not in (ABOUT, MODEL, MAP, NETWORK, VIEWS)),
                    "",
                )
                problem = f"holds {unexpected[:60]!r}" if unexpected else "lacks a part"
                raise ArtifactError(
                    f"{path}: no site, it {problem}; expected {ABOUT}, {MODEL} and {MAP}"
                )
            if sum(entries.values()) > LARGEST_BYTES:
                raise ArtifactError(
                    f"{path}: unpacks to {sum(entries.values()):,} bytes, more than a site has"
                )
            content = {name: file.read(name) for name in entries if views or name != VIEWS}
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
    # zipfile, zlib, json and safetensors raise whatever they like at a damaged file
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise ArtifactError(f"{path}: no whole site ({reason}); copy or pack it anew") from None
    if not isinstance(about, dict) or about.get("version") != VERSION:
        version = about.get("version") if isinstance(about, dict) else None
        raise ArtifactError(
            f"{path}: a site of version {version}, this yearloc reads version {VERSION}; pack it "
            "anew"
        )
    try:
        if "level" in about:
            return LevelParts(LevelDescription.from_json(about), arrays)
        description = SiteDescription.from_json(about)
    except ConfigError as error:
        raise ArtifactError(f"{path}: its {ABOUT}: {error}; pack the site anew") from None
    return Parts(description, model, arrays, content.get(NETWORK), view_arrays)
