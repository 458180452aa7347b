"""Artifacts: zarr groups of a declared kind and safetensors models, with their provenance in dvc.lock."""

import json
from collections.abc import Callable
from pathlib import Path

from pipeline import store
from pipeline.errors import ArtifactError
from pipeline.inspection import answers, columns, drives
from pipeline.inspection.inspection import Findings, Inspection, Section, nbytes
from pipeline.inspection.origin import changed, origin, short, size
from pipeline.schemas import ALL, Schema

KINDS = {schema.kind: schema for schema in ALL}
KEY_NUMBERS: dict[str, Callable[[store.Artifact], Findings]] = {
    "scans": drives.scans,
    "submaps": drives.submaps,
    "views": drives.views,
    "labels": answers.labels,
    "rankings": answers.rankings,
    "evaluations": answers.evaluations,
}


def artifact(path: Path, lock: Path) -> Inspection:
    """A zarr group; raises ArtifactError for one of an unknown kind, or one that cannot be read whole."""
    schema = _schema(path)
    try:
        opened = store.read(path, schema)
        extents = {name: columns.extent(opened[name]) for name in schema.columns}
        found = KEY_NUMBERS[schema.kind](opened) if schema.kind in KEY_NUMBERS else Findings()
    except ArtifactError:
        raise
    except Exception as error:  # zarr and its codecs may raise anything at a damaged shard
        reason = f"{type(error).__name__}: {(str(error).splitlines() or ['no reason given'])[0][:120]}"
        raise ArtifactError(f"{path}: cannot be read whole ({reason}); remove it and `dvc repro` it") from None
    first = str(next(iter(schema.columns)))
    rows = tuple(columns.row(name, extents[name], column) for name, column in schema.columns.items())
    attrs = tuple((name, short(opened.attrs.get(name)), doc) for name, doc in schema.attrs.items())
    infinite = tuple(
        f"inf in {name}: {extent.infinite:,} values; nothing here writes one: `dvc repro` it"
        for name, extent in extents.items()
        if extent.infinite and schema.kind != "rankings"
    )
    empty = () if extents[first].shape[0] else (f"no rows: {first} is empty; every later stage would have nothing to work on",)
    headline = f"{path} — {schema.kind}, version {schema.version}, {nbytes(size(path))} on disk"
    sections = [*found.sections, Section("arrays", rows), *([Section("attributes", attrs)] if attrs else []), origin(path, lock)]
    return Inspection(headline, tuple(sections), (*changed(path, lock), *empty, *infinite, *found.warnings))


def model(path: Path, lock: Path) -> Inspection:
    """A safetensors file: the named arrays of a model, and its training parameters."""
    recipe = store.read_recipe(path)
    arrays = store.read_model(path)
    extents = {name: columns.extent(array.reshape(-1) if not array.ndim else array) for name, array in sorted(arrays.items())}
    numbers = sum(array.size for array in arrays.values())
    bad = [name for name, extent in extents.items() if extent.nans or extent.infinite]
    sections = [Section(f"arrays: {len(arrays)}, {numbers:,} numbers", tuple(columns.row(*item) for item in extents.items()))]
    if recipe:
        sections.append(Section("recipe", tuple(sorted(recipe.items()))))
    sections.append(origin(path, lock))
    diverged = f"NaN/inf in {', '.join(bad)}: training diverged; lower its learning rate and `dvc repro` it"
    warnings = (*changed(path, lock), *([diverged] if bad else []))
    return Inspection(f"{path} — model, {nbytes(path.stat().st_size)} on disk", tuple(sections), warnings)


def _schema(path: Path) -> Schema:
    try:
        attrs = json.loads((path / "zarr.json").read_text()).get("attributes", {})
    except FileNotFoundError:
        raise ArtifactError(f"{path}: no zarr.json in it, so no artifact; `dvc repro` builds one") from None
    except (ValueError, AttributeError):
        raise ArtifactError(f"{path}/zarr.json: cut short or not JSON; remove it, and `dvc checkout` or `dvc repro` it") from None
    kind = attrs.get("kind") if isinstance(attrs, dict) else None
    if kind not in KINDS:
        raise ArtifactError(
            f"{path}: a zarr group of kind {kind}, which yearloc does not write; its kinds are {', '.join(KINDS)}"
        )
    return KINDS[str(kind)]
