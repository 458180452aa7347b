"""Describes an artifact for `yearloc inspect`: a path in; rows of text and warnings out.

An artifact is what a stage writes: a zarr group of one of the kinds in `dictionary`, or a model, an
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
from pipeline.inspection.dictionary import KINDS
from pipeline.inspection.inspection import Inspection, nbytes
from pipeline.inspection.origin import bytes_on_disk, one_line

KEY_NUMBERS: dict[str, Callable[[Any, Inspection], None]] = {
    "scans": drives.add_scans,
    "submaps": drives.add_submaps,
    "views": drives.add_views,
    "labels": answers.add_labels,
    "rankings": answers.add_rankings,
    "evaluations": answers.add_evaluations,
}
"""The function that adds the key numbers of an artifact, by its kind."""


def describe_artifact(path: Path, inspection: Inspection) -> None:
    """Describe a zarr group: its key numbers, arrays and attributes.

    Raises ArtifactError for a group of an unknown kind, or one that cannot be read whole.
    """
    schema = _schema(path)
    size_text = nbytes(bytes_on_disk(path))
    inspection.kind = f"{schema.kind}, version {schema.version}, {size_text} on disk"
    group = store.read(path, schema)
    extents = {name: columns.extent(group[name]) for name in schema.columns}
    # an artifact is empty if its first column is, which has a row a point, submap or query
    first_column = next(iter(schema.columns))
    is_empty = extents[first_column].shape[0] == 0
    inspection.warn_if(
        is_empty,
        f"no rows: {first_column} is empty; every later stage would have nothing to work on",
    )
    may_hold_inf = schema.kind == "rankings"  # the cost of an answer that does not exist
    for name, extent in extents.items():
        inspection.warn_if(
            extent.inf_count and not may_hold_inf,
            f"inf in {name}: {extent.inf_count:,} values; nothing here writes one: `dvc repro` it",
        )
    if schema.kind in KEY_NUMBERS:
        add_key_numbers = KEY_NUMBERS[schema.kind]
        add_key_numbers(group, inspection)
    rows = [columns.row(name, extents[name], column) for name, column in schema.columns.items()]
    inspection.add("arrays", *rows)
    if schema.attributes:
        attribute_rows = [
            (name, one_line(group.attrs.get(name)), meaning)
            for name, meaning in schema.attributes.items()
        ]
        inspection.add("attributes", *attribute_rows)


def describe_model(path: Path, inspection: Inspection) -> None:
    """Describe a model: its named arrays, and its recipe, the settings that it was trained with."""
    recipe = store.read_recipe(path)
    arrays = store.read_model(path)
    extents = {name: columns.extent(np.atleast_1d(array)) for name, array in sorted(arrays.items())}
    inspection.kind = f"model, {nbytes(path.stat().st_size)} on disk"
    number_count = sum(array.size for array in arrays.values())
    rows = [columns.row(name, extent) for name, extent in extents.items()]
    inspection.add(f"arrays: {len(arrays)}, {number_count:,} numbers", *rows)
    if recipe:
        inspection.add("recipe", *sorted(recipe.items()))
    diverged_arrays = [
        name for name, extent in extents.items() if extent.nan_count or extent.inf_count
    ]
    inspection.warn_if(
        bool(diverged_arrays),
        f"NaN/inf in {', '.join(diverged_arrays)}: training diverged; lower its learning rate and "
        "`dvc repro` it",
    )


def _schema(path: Path) -> type[store.Artifact]:
    """The schema of the kind that a zarr group declares in its attributes."""
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
