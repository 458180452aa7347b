"""The file of a site: a zip of site.json, model.safetensors, map.safetensors, and either
views.safetensors, by which it can grow, or, where it was exported, network.onnx.

Nothing in it is run when it is read, and nothing is unpacked to disk.
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

from pipeline.errors import ArtifactError, YearlocError
from pipeline.online.runtime import NETWORK
from pipeline.replacing import replace as replaced

ABOUT = "site.json"
MODEL = "model.safetensors"
MAP = "map.safetensors"
VIEWS = "views.safetensors"
VERSION = 3
LARGEST_BYTES = 2**32
KEYS = (
    "version",
    "name",
    "method",
    "view",
    "fixer",
    "k",
    "places",
    "map",
    "verdict",
    "reader",
    "sensor",
    "provenance",
)
EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file in the zip: the same site has the same bytes
Arrays = Mapping[str, NDArray[Any]]


class Parts(NamedTuple):
    """The content of a site file."""

    about: dict[str, Any]
    """What it says of itself (KEYS)."""
    model: Arrays
    """What the method learned."""
    arrays: Arrays
    """The map, and the cells of the places."""
    network: bytes | None
    """Exported to ONNX, in place of weights in `model`."""
    views: Arrays = MappingProxyType({})
    """What the model learned from, and its answers to held-out views; read only where they are
    asked for."""


def write(path: Path, parts: Parts) -> None:
    """Write a site file, whole or not at all; with a network that was exported, `model` has no
    weights."""
    held = {MODEL: parts.model, MAP: parts.arrays} | ({VIEWS: parts.views} if parts.views else {})
    content = {
        ABOUT: json.dumps({"version": VERSION, **parts.about}, indent=1, allow_nan=False).encode()
    }
    content |= {
        name: save({key: np.require(one, requirements="C") for key, one in part.items()})
        for name, part in held.items()
    }
    content |= {} if parts.network is None else {NETWORK: parts.network}
    with replaced(path) as scratch, zipfile.ZipFile(scratch, "w") as file:
        for name, data in content.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED, 6)


def read(path: Path, views: bool = False) -> Parts:
    """The content of a site file; raises ArtifactError as `Site.open` does."""
    if path.suffix == ".onnx":
        raise ArtifactError(
            f"{path}: a network alone; `yearloc export SITE -o FILE.site` writes a site that "
            "answers with it"
        )
    try:
        with zipfile.ZipFile(path) as file:
            entries = {entry.filename: entry.file_size for entry in file.infolist()}
            if set(entries) - {NETWORK, VIEWS} != {ABOUT, MODEL, MAP} or len(
                file.infolist()
            ) != len(entries):
                odd = next(
                    (name for name in entries if name not in (ABOUT, MODEL, MAP, NETWORK, VIEWS)),
                    "",
                )
                held = f"holds {odd[:60]!r}" if odd else "lacks a part"
                raise ArtifactError(
                    f"{path}: no site, it {held}; expected {ABOUT}, {MODEL} and {MAP}"
                )
            if sum(entries.values()) > LARGEST_BYTES:
                raise ArtifactError(
                    f"{path}: unpacks to {sum(entries.values()):,} bytes, more than a site has"
                )
            content = {name: file.read(name) for name in entries if views or name != VIEWS}
        about = json.loads(content[ABOUT])
        model = load(content[MODEL])
        arrays = load(content[MAP])
        learned = load(content[VIEWS]) if VIEWS in content else {}
    except FileNotFoundError:
        raise ArtifactError(
            f"{path}: no such site; `yearloc pack STUDY/GRID/METHOD -o {path.name}` writes one"
        ) from None
    except IsADirectoryError:
        raise ArtifactError(f"{path}: a folder, expected a site file") from None
    except YearlocError:
        raise
    except (
        Exception
    ) as error:  # zipfile, zlib, json and safetensors raise whatever they like at a damaged file
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise ArtifactError(f"{path}: no whole site ({reason}); copy or pack it anew") from None
    if not isinstance(about, dict) or about.get("version") != VERSION:
        version = about.get("version") if isinstance(about, dict) else None
        raise ArtifactError(
            f"{path}: a site of version {version}, this yearloc reads version {VERSION}; pack it "
            "anew"
        )
    if lacking := [key for key in KEYS if key not in about]:
        raise ArtifactError(f"{path}: its {ABOUT} has no {lacking[0]}; pack the site anew")
    return Parts(about, model, arrays, content.get(NETWORK), learned)
