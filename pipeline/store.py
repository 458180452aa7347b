"""Artifacts on disk, written whole or not at all: zarr groups of a declared schema, and models.

A model is a zarr group too, of arrays by any names, and lies in one zip: a network has some two
hundred arrays, and each would be a folder.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import ZipFile, ZipInfo
from zlib import crc32

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.core.buffer import Buffer
from zarr.storage import MemoryStore, ZipStore

from pipeline import remote, sealed
from pipeline.errors import ArtifactError
from pipeline.replacing import replace as replace

MODEL = ".zarr.zip"
"""How the file of a model ends."""
MODEL_KIND = {"kind": "model", "version": 1}


@dataclass(frozen=True)
class Column:
    """One array of an artifact; its first dimension is the row dimension."""

    dtype: str
    dims: tuple[str, ...]
    doc: str
    chunk: int = 65_536
    """Rows read and compressed together."""
    shard: int = 4_194_304
    """Rows in one file; a multiple of `chunk`."""


@dataclass(frozen=True)
class Schema:
    """One kind of artifact: a zarr group with these arrays and attributes.

    It has the attributes `kind` and `version` too.
    """

    kind: str
    version: int
    columns: Mapping[str, Column]
    attrs: Mapping[str, str] = field(default_factory=dict)


class Artifact:
    """A finished artifact, opened for reading.

    `artifact["column"]` is an array to be sliced, `artifact.attrs` its numbers.
    """

    def __init__(self, path: Path | str, group: zarr.Group) -> None:
        self.path = path
        self.attrs: dict[str, Any] = {
            name: value for name, value in group.attrs.items() if name != sealed.SEAL
        }
        self._group = group

    def __getitem__(self, name: str) -> sealed.Stored:
        return sealed.Stored(self.path, self._group[name])

    def load(self, name: str) -> NDArray[Any]:
        """A whole column as an array."""
        return np.asarray(self[name][:])


def read(path: str | Path, *schemas: Schema) -> Artifact:
    """Open an artifact in a folder, or in an object store as s3://BUCKET/PATH.

    Raises ArtifactError if it is missing or not of the kind and version of one of the schemas.
    """
    if remote.is_remote(path):
        remote.look(f"{path}/zarr.json")
    elif not Path(path, "zarr.json").is_file():
        raise ArtifactError(f"{path}: no such artifact; `dvc repro` builds it")
    try:
        group = zarr.open_group(path, mode="r")
    except (ValueError, KeyError, TypeError) as error:
        raise ArtifactError(f"{path}: not a whole zarr group ({error}); {sealed.REBUILD}") from None
    kind = group.attrs.get("kind")
    version = group.attrs.get("version")
    if (kind, version) not in [(schema.kind, schema.version) for schema in schemas]:
        expected = " or ".join(f"{schema.kind} version {schema.version}" for schema in schemas)
        raise ArtifactError(
            f"{path}: expected {expected}, found {kind} version {version}; `dvc repro` builds it "
            "anew"
        )
    sealed.check_metadata(path, group)
    return Artifact(path if remote.is_remote(path) else Path(path), group)


class Draft:
    """An artifact being written: `put` takes a whole column, `append` the next rows of one."""

    def __init__(self, group: zarr.Group, schema: Schema) -> None:
        self._group = group
        self._schema = schema
        self._waiting: dict[str, list[NDArray[Any]]] = {}
        self._arrays: dict[str, Any] = {}

    def put(self, name: str, rows: NDArray[Any]) -> None:
        """Write the column `name` whole, once.

        Floats may be rounded to the schema's type, integers must fit.
        """
        if name in self._waiting:
            raise ArtifactError(f"{self._schema.kind}.{name}: written already")
        self.append(name, rows)

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Write the next rows of column `name`, a whole shard at a time.

        Unaligned shard writes corrupt (zarr #3682).
        """
        column = self._column(name)
        rows = np.asarray(rows)
        if rows.ndim != len(column.dims) or not np.can_cast(rows.dtype, column.dtype, "same_kind"):
            raise ArtifactError(
                f"{self._schema.kind}.{name}: {rows.dtype}{rows.shape} does not fit "
                f"{column.dtype}{column.dims}"
            )
        cast = rows.astype(column.dtype, copy=False)
        if cast.dtype.kind in "iu" and (cast != rows).any():
            raise ArtifactError(f"{self._schema.kind}.{name}: a value does not fit {column.dtype}")
        waiting_rows = self._waiting.setdefault(name, [])
        waiting_rows.append(cast)
        if sum(map(len, waiting_rows)) >= column.shard:
            joined = np.concatenate(waiting_rows)
            whole_rows = len(joined) // column.shard * column.shard
            self._write(name, column, joined[:whole_rows])
            self._waiting[name] = [joined[whole_rows:]]

    def finish(self, attrs: Mapping[str, object]) -> None:
        """Write what waits, set the attributes and check the whole against the schema."""
        for name, waiting_rows in self._waiting.items():
            self._write(name, self._column(name), np.concatenate(waiting_rows))
        self._waiting.clear()
        schema = self._schema
        self._group.attrs.update({"kind": schema.kind, "version": schema.version, **attrs})
        if set(attrs) != set(schema.attrs):
            raise ArtifactError(
                f"{schema.kind}: attributes {sorted(attrs)} are not {sorted(schema.attrs)}"
            )
        if set(self._group.array_keys()) != set(schema.columns):
            raise ArtifactError(
                f"{schema.kind}: arrays {sorted(self._group.array_keys())} are not "
                f"{sorted(schema.columns)}"
            )
        lengths: dict[str, int] = {}
        for name, column in schema.columns.items():
            for dim, length in zip(column.dims, self._group[name].shape, strict=True):
                rows = length - 1 if dim.endswith("+1") else length
                if lengths.setdefault(dim.removesuffix("+1"), rows) != rows:
                    raise ArtifactError(
                        f"{schema.kind}.{name}: {rows} along {dim}, elsewhere "
                        f"{lengths[dim.removesuffix('+1')]}"
                    )

    def seal(self, path: Path) -> None:
        """Write the checksum of the metadata, once nothing follows."""
        self._group.attrs[sealed.SEAL] = sealed.metadata_checksum(path)

    def _column(self, name: str) -> Column:
        if name not in self._schema.columns:
            raise ArtifactError(f"{self._schema.kind} has no column {name}")
        return self._schema.columns[name]

    def _write(self, name: str, column: Column, rows: NDArray[Any]) -> None:
        if name not in self._arrays:
            shape = (0, *rows.shape[1:])
            self._arrays[name] = self._group.create_array(
                name,
                shape=shape,
                dtype=rows.dtype,
                chunks=(column.chunk, *(max(1, side) for side in rows.shape[1:])),
                shards=(column.shard, *(max(1, side) for side in rows.shape[1:])),
                # c.0.0: no folders, each of which DVC would visit
                chunk_key_encoding={"name": "default", "separator": "."},
                dimension_names=column.dims,
                compressors=sealed.COMPRESSOR,
                config=sealed.ALL_CHUNKS,
            )
        if len(rows):
            array = self._arrays[name]
            start = array.shape[0]
            array.resize((start + len(rows), *array.shape[1:]))
            array[start:] = rows


@contextmanager
def write(path: str | Path, schema: Schema, **attrs: object) -> Iterator[Draft]:
    """Draft an artifact, which appears at `path` only if the block ends well and fits the schema.

    An attribute that is known only at the end may be a callable without arguments.
    """
    with replace(path) as scratch:
        draft = Draft(zarr.create_group(scratch), schema)
        yield draft
        draft.finish({name: value() if callable(value) else value for name, value in attrs.items()})
        draft.seal(scratch)


def write_model(
    path: str | Path, model: Mapping[str, NDArray[Any]], recipe: Mapping[str, object]
) -> None:
    """Write named arrays as a zarr group in one zip; equal models have equal bytes.

    The group's attribute `recipe` has the parameters that they were learned with, as texts.
    """
    members: dict[str, Buffer] = {}
    group = zarr.create_group(MemoryStore(members))
    for name, array in model.items():
        group.create_array(
            name,
            data=np.require(array, requirements="C"),
            chunks=tuple(max(1, length) for length in array.shape),
            compressors=None,  # weights hardly shrink
            config=sealed.ALL_CHUNKS,
        )
    words = {name: str(value) for name, value in recipe.items()}
    group.attrs.update({**MODEL_KIND, sealed.SEAL: _checksum(members), "recipe": words})
    try:
        with replace(path) as scratch, ZipFile(scratch, "w") as archive:
            for name in sorted(members):
                archive.writestr(ZipInfo(name), members[name].to_bytes())  # dated 1980, all of them
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_model(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a model's named arrays; raises ArtifactError if the file is missing or damaged."""
    read_recipe(path)
    with _whole(path), ZipStore(path, mode="r") as zip_store:
        members = zarr.open_group(zip_store, mode="r").members(max_depth=None)
        return {
            name: np.asarray(array[...]) for name, array in members if isinstance(array, zarr.Array)
        }


def read_recipe(path: str | Path) -> dict[str, str]:
    """Read the parameters that a model was learned with; raises as `read_model`."""
    with _whole(path), ZipFile(path) as archive:
        attrs = json.loads(archive.read("zarr.json"))["attributes"]
        recipe: dict[str, str] = attrs.pop("recipe")
        if attrs != {**MODEL_KIND, sealed.SEAL: _checksum(archive.namelist())}:
            raise ValueError("its files are not those that were written")
    return recipe


@contextmanager
def _whole(path: str | Path) -> Iterator[None]:
    """Say in one line what is wrong with a model's file: each file in the zip has a checksum."""
    if not Path(path).exists():
        raise ArtifactError(f"{path}: no such model; `dvc repro` trains it")
    if Path(path).is_dir():
        raise ArtifactError(f"{path}: a folder, expected a model in one file")
    try:
        yield
    except Exception as error:  # zipfile and zarr may raise anything at a damaged file
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise ArtifactError(f"{path}: not a whole model ({reason}); {sealed.REBUILD}") from None


def _checksum(names: Iterable[str]) -> int:
    """The checksum of the names of a model's files."""
    return crc32("\n".join(sorted(names)).encode())
