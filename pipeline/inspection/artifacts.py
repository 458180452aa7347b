"""Artifacts: zarr groups of a declared kind and safetensors models, with what dvc.lock knows of their making."""

import json
from pathlib import Path
from typing import Any

import zarr

from pipeline import provenance, store
from pipeline.errors import ArtifactError
from pipeline.inspection import columns, highlights
from pipeline.inspection.inspection import Inspection, Section, nbytes
from pipeline.schemas import ALL, Schema

KINDS = {schema.kind: schema for schema in ALL}


def artifact(path: Path, lock: Path) -> Inspection:
    """A zarr group; raises ArtifactError for one of no known kind, or one that cannot be read whole."""
    schema = _schema(path)
    try:
        opened = store.read(path, schema)
        extents = {name: columns.extent(opened[name]) for name in schema.columns}
        lost = _lost(opened, schema)
        found = highlights.of(schema.kind, opened)
    except ArtifactError:
        raise
    except Exception as error:  # zarr and its codecs raise whatever they like at a damaged shard
        raise ArtifactError(
            f"{path}: cannot be read whole ({type(error).__name__}: {_line(error)}); remove it and `dvc repro` it"
        ) from None
    first = str(next(iter(schema.columns)))
    rows = tuple(columns.row(name, extents[name], column) for name, column in schema.columns.items())
    attrs = tuple((name, _short(opened.attrs.get(name)), doc) for name, doc in schema.attrs.items())
    infinite = tuple(
        f"inf in {name}: {extent.infinite:,} values; nothing here writes one: `dvc repro` it"
        for name, extent in extents.items()
        if extent.infinite and schema.kind != "rankings"
    )
    empty = () if extents[first].shape[0] else (f"no rows: {first} is empty; every later stage would have nothing to work on",)
    return Inspection(
        f"{path} — {schema.kind}, version {schema.version}, {nbytes(_size(path))} on disk",
        (
            *found.sections,
            Section("arrays", rows),
            *((Section("attributes", attrs),) if attrs else ()),
            origin(path, lock),
        ),
        (*lost, *empty, *infinite, *found.warnings),
    )


def model(path: Path, lock: Path) -> Inspection:
    """A safetensors file: named arrays and the parameters that they were learned with."""
    recipe = store.read_recipe(path)
    arrays = store.read_model(path)
    extents = {name: columns.extent(array.reshape(-1) if not array.ndim else array) for name, array in sorted(arrays.items())}
    numbers = sum(array.size for array in arrays.values())
    bad = [name for name, extent in extents.items() if extent.nans or extent.infinite]
    sections = [Section(f"arrays: {len(arrays)}, {numbers:,} numbers", tuple(columns.row(*item) for item in extents.items()))]
    if recipe:
        sections.append(Section("recipe", tuple(sorted(recipe.items()))))
    sections.append(origin(path, lock))
    found = (f"NaN/inf in {', '.join(bad)}: training diverged; lower its learning rate and `dvc repro` it",) if bad else ()
    return Inspection(f"{path} — model, {nbytes(path.stat().st_size)} on disk", tuple(sections), found)


def origin(path: Path, lock: Path) -> Section:
    """What dvc.lock says of the stage that wrote `path`, or the folder around it."""
    known = None
    try:
        below = path.resolve().relative_to(lock.resolve().parent)
    except ValueError:
        below = path
    for place in (below, *below.parents):
        known = known or provenance.recipe(place, lock)
    if known is None:
        why = f"{lock} knows it not: made by hand, by a sweep, or not yet committed" if lock.is_file() else f"there is no {lock}"
        return Section("provenance", (("unknown", why),))
    rows = [("stage", str(known["stage"])), ("cmd", str(known.get("cmd", "")))]
    for file, values in (known.get("params") or {}).items():
        rows.append(("params", f"{file}: " + ", ".join(f"{key}={_short(value)}" for key, value in (values or {}).items())))
    rows += [("deps" if i == 0 else "", _dep(dep)) for i, dep in enumerate(known.get("deps") or [])]
    return Section("provenance", tuple(rows))


def _schema(path: Path) -> Schema:
    try:
        attrs = json.loads((path / "zarr.json").read_text()).get("attributes", {})
    except FileNotFoundError:
        raise ArtifactError(f"{path}: no zarr.json in it, so no artifact; `dvc repro` builds one") from None
    except (ValueError, AttributeError):
        raise ArtifactError(
            f"{path}/zarr.json: cut short or not JSON; remove the artifact, and `dvc checkout` or `dvc repro` it"
        ) from None
    kind = attrs.get("kind") if isinstance(attrs, dict) else None
    if kind not in KINDS:
        raise ArtifactError(
            f"{path}: a zarr group of kind {kind}, which yearloc does not write; its kinds are {', '.join(KINDS)}"
        )
    return KINDS[str(kind)]


def _lost(opened: store.Artifact, schema: Schema) -> tuple[str, ...]:
    """Arrays with fewer shard files than their rows need: zarr reads a lost one as zeros, without a word."""
    found = []
    for name, column in schema.columns.items():
        array: Any = opened[name]
        if not isinstance(array, zarr.Array) or not array.shape[0]:
            continue
        wanted = -(-array.shape[0] // column.shard)
        there = sum(1 for file in (opened.path / name).rglob("*") if file.is_file() and file.name != "zarr.json")
        if there < wanted:
            found.append(
                f"{name}: {there} of {wanted} shard files on disk; the rest reads as zeros: remove it and `dvc repro` it"
            )
    return tuple(found)


def _dep(dep: dict[str, Any]) -> str:
    count = f", {dep['nfiles']} files" if "nfiles" in dep else ""
    size = f", {nbytes(int(dep['size']))}" if "size" in dep else ""
    return f"{dep.get('path')} ({str(dep.get('md5', dep.get('hash', '')))[:8]}{size}{count})"


def _short(value: object) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_short(item) for item in value) + "]"
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_short(item)}" for key, item in value.items()) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _line(error: Exception) -> str:
    return (str(error).splitlines() or ["no reason given"])[0][:120]
