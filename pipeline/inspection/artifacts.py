"""Artifacts: zarr groups of a declared kind, and models."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def artifact(path: Path, inspection: Inspection) -> None:
    """Describe a zarr group.

    Raises ArtifactError for one of an unknown kind, or one that cannot be read whole.
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
    for name, extent in extents.items() if kind.kind != "rankings" else ():
        inspection.warn(
            extent.infinite,
            f"inf in {name}: {extent.infinite:,} values; nothing here writes one: `dvc repro` it",
        )
    if kind.kind in KEY_NUMBERS:
        KEY_NUMBERS[kind.kind](group, inspection)
    inspection.add(
        "arrays",
        *(columns.row(name, extents[name], column) for name, column in kind.columns.items()),
    )
    if kind.attributes:
        inspection.add(
            "attributes",
            *((name, short(group.attrs.get(name)), doc) for name, doc in kind.attributes.items()),
        )


def model(path: Path, inspection: Inspection) -> None:
    """Describe a model: its named arrays and its training parameters."""
    recipe = store.read_recipe(path)
    arrays = store.read_model(path)
    extents = {
        name: columns.extent(array.reshape(-1) if not array.ndim else array)
        for name, array in sorted(arrays.items())
    }
    inspection.kind = f"model, {nbytes(path.stat().st_size)} on disk"
    numbers = sum(array.size for array in arrays.values())
    inspection.add(
        f"arrays: {len(arrays)}, {numbers:,} numbers",
        *(columns.row(*item) for item in extents.items()),
    )
    if recipe:
        inspection.add("recipe", *sorted(recipe.items()))
    diverged = [name for name, extent in extents.items() if extent.nans or extent.infinite]
    inspection.warn(
        diverged,
        f"NaN/inf in {', '.join(diverged)}: training diverged; lower its learning rate and `dvc "
        "repro` it",
    )


def _kind(path: Path) -> type[store.Artifact]:
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
