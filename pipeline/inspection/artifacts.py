"""Describes an artifact for `yearloc inspect`: a path in; rows of text and warnings out.

An artifact is what a stage writes: a zarr group of one of the kinds in `kinds`, or a model, an
archive of named arrays.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import store
from pipeline.core.errors import ArtifactError
from pipeline.inspection import answers, columns, drives
from pipeline.inspection.inspection import Inspection, nbytes
from pipeline.inspection.kinds import KINDS
from pipeline.inspection.origin import short, size

KEY_NUMBERS: dict[str, Callable[[Any, Inspection], None]] = {
    "scans": drives.scans,
    "submaps": drives.submaps,
    "views": drives.views,
    "labels": answers.labels,
    "rankings": answers.rankings,
    "evaluations": answers.evaluations,
}
"""The function that adds the key numbers of an artifact, by its kind."""


def artifact(path: Path, inspection: Inspection) -> None:
    """Describe a zarr group: its key numbers, arrays and attributes.

    Raises ArtifactError for a group of an unknown kind, or one that cannot be read whole.
    """
    kind = _kind(path)
    inspection.kind = f"{kind.kind}, version {kind.version}, {nbytes(size(path))} on disk"
    group = store.read(path, kind)
    extents = {name: columns.extent(group[name]) for name in kind.columns}
    first_column = next(iter(kind.columns))
    inspection.warn(
        not extents[first_column].shape[0],
        f"no rows: {first_column} is empty; every later stage would have nothing to work on",
    )
    may_hold_inf = kind.kind == "rankings"
    for name, extent in extents.items():
        inspection.warn(
            extent.infinite and not may_hold_inf,
            f"inf in {name}: {extent.infinite:,} values; nothing here writes one: `dvc repro` it",
        )
    if kind.kind in KEY_NUMBERS:
        KEY_NUMBERS[kind.kind](group, inspection)
    rows = [columns.row(name, extents[name], column) for name, column in kind.columns.items()]
    inspection.add("arrays", *rows)
    if kind.attributes:
        inspection.add(
            "attributes",
            *((name, short(group.attrs.get(name)), doc) for name, doc in kind.attributes.items()),
        )


def model(path: Path, inspection: Inspection) -> None:
    """Describe a model: its named arrays, and its recipe, the settings that it was trained with."""
    recipe = store.read_recipe(path)
    arrays = store.read_model(path)
    extents = {name: columns.extent(np.atleast_1d(array)) for name, array in sorted(arrays.items())}
    inspection.kind = f"model, {nbytes(path.stat().st_size)} on disk"
    numbers = sum(array.size for array in arrays.values())
    rows = [columns.row(name, extent) for name, extent in extents.items()]
    inspection.add(f"arrays: {len(arrays)}, {numbers:,} numbers", *rows)
    if recipe:
        inspection.add("recipe", *sorted(recipe.items()))
    diverged = [name for name, extent in extents.items() if extent.nans or extent.infinite]
    inspection.warn(
        diverged,
        f"NaN/inf in {', '.join(diverged)}: training diverged; lower its learning rate and `dvc "
        "repro` it",
    )


def _kind(path: Path) -> type[store.Artifact]:
    """The kind that a zarr group declares in its attributes."""
    try:
        attrs = json.loads((path / "zarr.json").read_text(encoding="utf-8")).get("attributes", {})
    except FileNotFoundError:
        raise ArtifactError(
            f"{path}: no zarr.json in it, so no artifact; `dvc repro` builds one"
        ) from None
    except (ValueError, AttributeError):
        raise ArtifactError(
            f"{path}/zarr.json: cut short or not JSON; remove it, and `dvc checkout` or `dvc "
            "repro` it"
        ) from None
    name = attrs.get("kind") if isinstance(attrs, dict) else None
    if name not in KINDS:
        kinds = ", ".join(KINDS)
        raise ArtifactError(
            f"{path}: a zarr group of kind {name}, which yearloc does not write; its kinds are "
            f"{kinds}"
        )
    return KINDS[name]
