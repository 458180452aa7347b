"""Reads and writes artifacts, what one stage leaves on disk for the next: whole or not at all.

An artifact is a zarr group of a declared kind. The kind is a frozen dataclass (core.schemas), whose
annotated fields say which arrays and attributes the group has. `read` opens an artifact, `write`
writes one that is in memory, and `draft` writes one block by block.

A model, what a method learned, is a zarr group of arrays by any names. It lies in one zip file,
since a network has some two hundred arrays and each would be a folder (`write_model`,
`read_model`).
"""

import dataclasses
import json
import math
from collections import abc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Self,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)
from zipfile import ZipFile, ZipInfo
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from pipeline.core import remote, sealed
from pipeline.core.errors import ArtifactError
from pipeline.core.replacing import replace as replace  # exported too, for files of other kinds

if TYPE_CHECKING:  # a robot that localises in a site reads no artifact
    import zarr
    from zarr.abc.buffer import Buffer

MODEL = ".zarr.zip"
"""How the name of a model's file ends."""
MODEL_KIND = {"kind": "model", "version": 1}
"""Attributes of the zarr group of every model."""


@dataclass(frozen=True)
class Array:
    """Describes an array of an artifact: `Annotated[NDArray[np.float32], Array(...)]`."""

    dims: tuple[str, ...]
    """A name for each dimension, rows first. Dimensions of one name have one length within an
    artifact; `scan+1` marks an array of offsets, which is one longer than there are scans."""
    says: str
    """What a number in the array means."""
    unit: str = ""
    """The unit of its numbers, as xarray shows it; empty for counts, indices and shares."""
    chunk: int = 65_536
    """How many rows are read and compressed together."""
    shard: int = 4_194_304
    """How many rows lie in one file; a multiple of `chunk`."""
    dtype: str = ""
    """The type of its numbers, such as float32; `define` takes it from the annotation."""


@dataclass(frozen=True)
class Stack:
    """Describes a sequence of dataclasses that are stored in common arrays.

    `Annotated[Sequence[Judgement], Stack("protocol")]` stores the arrays of all judgements along a
    further first dimension, `protocol`. Each judgement is read by itself. Their attributes are
    stored once: those of the first.
    """

    dim: str
    """The name of the further dimension."""
    chunk: int = 1
    """How many of the dataclasses are read and compressed together."""
    shard: int = 64
    """How many of them lie in one file."""


@dataclass(frozen=True)
class Definition:
    """The arrays, attributes and stacks of a dataclass, by the names of its fields."""

    arrays: Mapping[str, Array]
    attributes: Mapping[str, tuple[Any, str]]
    """The type and the meaning of each attribute."""
    stacks: Mapping[str, tuple[Stack, type]]
    """How each sequence of dataclasses is stored, and the class of its items."""

    @property
    def columns(self) -> dict[str, Array]:
        """All arrays by name, with those of stacked dataclasses in their further dimension.

        An array of an artifact is called a column.
        """
        columns = dict(self.arrays)
        for stack, item_type in self.stacks.values():
            for name, array in define(item_type).columns.items():
                dims = (stack.dim, *array.dims)
                columns[name] = dataclasses.replace(
                    array, dims=dims, chunk=stack.chunk, shard=stack.shard
                )
        return columns

    @property
    def meanings(self) -> dict[str, str]:
        """The meaning of every attribute by name, with those of stacked dataclasses."""
        meanings = {name: meaning for name, (_, meaning) in self.attributes.items()}
        for _, item_type in self.stacks.values():
            meanings |= define(item_type).meanings
        return meanings


def define(cls: type) -> Definition:
    """Make the definition of a dataclass from the annotations of its fields."""
    arrays = {}
    attributes = {}
    stacks = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            continue
        field_type, description = get_args(hint)
        if isinstance(description, Array):
            *_, dtype = get_args(field_type)  # dtype[float32]; float32 itself since numpy 2.5
            scalar, *_ = get_args(dtype) or (dtype,)
            arrays[name] = dataclasses.replace(description, dtype=np.dtype(scalar).name)
        elif isinstance(description, Stack):
            item_type, *_ = get_args(field_type)
            stacks[name] = (description, item_type)
        else:
            attributes[name] = (field_type, description)
    return Definition(arrays, attributes, stacks)


class Artifact:
    """Base class of all kinds of artifacts: a zarr group of arrays and attributes.

    A kind is a frozen dataclass whose fields are annotated with `Array` (an array), a sentence (an
    attribute) or `Stack`. An artifact is either made in memory from its fields, or opened by
    `read`. Of an opened one, `artifact.column` reads an array whole when it is first used, and
    `artifact["column"]` is an array on disk that reads only the slices that are taken of it.
    """

    # what `__init_subclass__` sets on each kind, from its annotations
    kind: ClassVar[str]
    version: ClassVar[int]
    definition: ClassVar[Definition]
    columns: ClassVar[Mapping[str, Array]]
    attributes: ClassVar[Mapping[str, str]]
    """What each attribute means."""
    # what `_opened` sets; an artifact made in memory has no `_stored_attrs`, and none asks for them
    path: Path | str = ""
    """Where it was opened; empty if it was made in memory."""
    _group: Any = None
    """The zarr group of an opened artifact."""
    _stored_attrs: dict[str, Any]
    """The attributes of an opened artifact, without the seal."""

    def __init_subclass__(cls, kind: str = "", version: int = 0) -> None:
        cls.kind = kind
        cls.version = version
        cls.definition = define(cls)
        cls.columns = cls.definition.columns
        cls.attributes = cls.definition.meanings

    @property
    def attrs(self) -> dict[str, Any]:
        """The attributes as they are written, `kind` and `version` among them."""
        if self._group is not None:
            return self._stored_attrs
        _, attrs = _flat(self)
        return {"kind": self.kind, "version": self.version, **attrs}

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name, as they are written; those of an opened artifact are read whole."""
        arrays, _ = _flat(self)
        return arrays

    def __getitem__(self, name: str) -> Any:
        if self._group is None:
            return self.arrays[name]
        return sealed.StoredArray(self.path, self._group[name])

    def load(self, name: str) -> NDArray[Any]:
        """Read a whole column as an array."""
        return np.asarray(self[name][:])

    @classmethod
    def _opened(cls, path: Path | str, group: "zarr.Group") -> Self:
        """The artifact of a zarr group; its fields are read when they are first used."""
        # a kind is a frozen dataclass that wants all fields: it is made without __init__, and its
        # dictionary filled
        artifact = cls.__new__(cls)
        artifact.__dict__["path"] = path
        artifact.__dict__["_group"] = group
        artifact.__dict__["_stored_attrs"] = {
            name: value for name, value in group.attrs.items() if name != sealed.SEAL
        }
        return artifact

    if not TYPE_CHECKING:  # hidden from mypy, for which a misspelt field is an error then

        def __getattr__(self, name: str) -> Any:
            """Read a field when it is first used, and keep it.

            Python calls this only for a name that the object does not have yet.
            """
            fields = self.definition
            if name in fields.arrays:
                value = self.load(name)
            elif name in fields.attributes:
                attribute_type, _ = fields.attributes[name]
                value = _decoded(attribute_type, self._stored_attrs[name])
            elif name in fields.stacks:
                _, item_type = fields.stacks[name]
                value = _StackedItems(self, item_type)
            else:
                raise AttributeError(name)
            self.__dict__[name] = value
            return value


A = TypeVar("A", bound=Artifact)
"""A kind of artifact."""


def read(path: str | Path, *kinds: type[A]) -> A:
    """Open an artifact in a folder, or in an object store as s3://BUCKET/PATH.

    Raises ArtifactError if it is missing or damaged, or not of one of the kinds in this version.
    """
    import zarr

    if remote.is_remote(path):
        remote.look(f"{path}/zarr.json")
    elif not Path(path, "zarr.json").is_file():
        raise ArtifactError(f"{path}: no such artifact; `dvc repro` builds it")
    try:
        group = zarr.open_group(path, mode="r")
    except (ValueError, KeyError, TypeError) as error:
        raise ArtifactError(f"{path}: not a whole zarr group ({error}); {sealed.REBUILD}") from None
    stored_kind = group.attrs.get("kind")
    stored_version = group.attrs.get("version")
    for kind in kinds:
        if (stored_kind, stored_version) == (kind.kind, kind.version):
            sealed.check_metadata(path, group)
            return kind._opened(path if remote.is_remote(path) else Path(path), group)
    expected = " or ".join(f"{kind.kind} version {kind.version}" for kind in kinds)
    raise ArtifactError(
        f"{path}: expected {expected}, found {stored_kind} version {stored_version}; `dvc repro` "
        "rebuilds it"
    )


def write(path: str | Path, artifact: Artifact) -> None:
    """Write an artifact that was made in memory."""
    arrays, attrs = _flat(artifact)
    with draft(path, type(artifact), **attrs) as out:
        for name, rows in arrays.items():
            out.put(name, rows)


@contextmanager
def draft(path: str | Path, kind: type[Artifact], **attrs: object) -> Iterator["Draft"]:
    """Yield a draft, which becomes the artifact at `path` if the block ends well.

    Raises ArtifactError, and leaves `path` as it was, if the draft does not fit `kind`. `attrs` are
    the attributes; one that is known only at the end may be a callable without arguments, which is
    called then.
    """
    import zarr

    with replace(path) as scratch:
        out = Draft(zarr.create_group(scratch), kind)
        yield out
        out.finish({name: value() if callable(value) else value for name, value in attrs.items()})
        out.seal(scratch)


class Draft:
    """An artifact being written: `put` takes a whole column, `append` the next rows of one."""

    def __init__(self, group: "zarr.Group", kind: type[Artifact]) -> None:
        self._group = group
        self._kind = kind
        self._waiting: dict[str, list[NDArray[Any]]] = {}
        """The rows of each column that do not fill a shard yet."""
        self._arrays: dict[str, Any] = {}
        """The zarr array of each column."""

    def put(self, name: str, rows: NDArray[Any]) -> None:
        """Write the column `name` whole, once.

        Floats are rounded to the column's type; integers that do not fit raise ArtifactError.
        """
        if name in self._waiting:
            raise ArtifactError(f"{self._kind.kind}.{name}: written already")
        self.append(name, rows)

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of column `name`, and write those that fill whole shards.

        The rest waits for further rows or for `finish`, since zarr corrupts rows if a write begins
        within a shard (zarr #3682).
        """
        column = self._column(name)
        rows = np.asarray(rows)
        if rows.ndim != len(column.dims) or not np.can_cast(rows.dtype, column.dtype, "same_kind"):
            raise ArtifactError(
                f"{self._kind.kind}.{name}: {rows.dtype}{rows.shape} does not fit "
                f"{column.dtype}{column.dims}"
            )
        cast_rows = rows.astype(column.dtype, copy=False)
        if cast_rows.dtype.kind in "iu" and (cast_rows != rows).any():
            raise ArtifactError(f"{self._kind.kind}.{name}: a value does not fit {column.dtype}")
        waiting_rows = self._waiting.setdefault(name, [])
        waiting_rows.append(cast_rows)
        if sum(map(len, waiting_rows)) >= column.shard:
            joined = np.concatenate(waiting_rows)
            n_rows = len(joined) // column.shard * column.shard  # of all whole shards
            self._write(name, column, joined[:n_rows])
            self._waiting[name] = [joined[n_rows:]]

    def finish(self, attrs: Mapping[str, object]) -> None:
        """Write the rows that wait, set the attributes and check the whole against the kind.

        Raises ArtifactError if an array or attribute is missing or surplus, or if dimensions of one
        name differ in length.
        """
        for name, waiting_rows in self._waiting.items():
            self._write(name, self._column(name), np.concatenate(waiting_rows))
        self._waiting.clear()
        kind = self._kind
        self._group.attrs.update({"kind": kind.kind, "version": kind.version, **attrs})
        if set(attrs) != set(kind.attributes):
            raise ArtifactError(
                f"{kind.kind}: attributes {sorted(attrs)} are not {sorted(kind.attributes)}"
            )
        if set(self._group.array_keys()) != set(kind.columns):
            raise ArtifactError(
                f"{kind.kind}: arrays {sorted(self._group.array_keys())} are not "
                f"{sorted(kind.columns)}"
            )
        self._check_lengths()

    def _check_lengths(self) -> None:
        """Raise ArtifactError unless dimensions of one name have one length."""
        kind = self._kind
        lengths: dict[str, int] = {}
        for name, column in kind.columns.items():
            for dim, length in zip(column.dims, self._group[name].shape, strict=True):
                rows = length - 1 if dim.endswith("+1") else length
                if lengths.setdefault(dim.removesuffix("+1"), rows) != rows:
                    raise ArtifactError(
                        f"{kind.kind}.{name}: {rows} along {dim}, elsewhere "
                        f"{lengths[dim.removesuffix('+1')]}"
                    )

    def seal(self, path: Path) -> None:
        """Write the checksum of the metadata; nothing may be written after it."""
        self._group.attrs[sealed.SEAL] = sealed.metadata_checksum(path)

    def _column(self, name: str) -> Array:
        """The description of a column; raises ArtifactError if the kind has none of this name."""
        if name not in self._kind.columns:
            raise ArtifactError(f"{self._kind.kind} has no column {name}")
        return self._kind.columns[name]

    def _write(self, name: str, column: Array, rows: NDArray[Any]) -> None:
        """Write rows at the end of a column's zarr array; the first ones create it."""
        if name not in self._arrays:
            row_shape = rows.shape[1:]
            row_chunk = tuple(max(1, side) for side in row_shape)
            self._arrays[name] = self._group.create_array(
                name,
                shape=(0, *row_shape),
                dtype=rows.dtype,
                chunks=(column.chunk, *row_chunk),
                shards=(column.shard, *row_chunk),
                # files c.0.0 instead of folders c/0/0, each of which DVC would visit
                chunk_key_encoding={"name": "default", "separator": "."},
                dimension_names=column.dims,
                attributes={"units": column.unit} if column.unit else {},
                compressors=sealed.compressor(),
                config=sealed.ALL_CHUNKS,
            )
        if len(rows):
            array = self._arrays[name]
            start = array.shape[0]
            array.resize((start + len(rows), *array.shape[1:]))
            array[start:] = rows


def write_model(
    path: str | Path, model: Mapping[str, NDArray[Any]], recipe: Mapping[str, object]
) -> None:
    """Write a model's named arrays as a zarr group in one zip; equal models have equal bytes.

    `recipe` has the parameters that the model was learned with; they are written as texts. Raises
    ArtifactError if the file cannot be written.
    """
    import zarr
    from zarr.storage import MemoryStore

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
    group.attrs.update({**MODEL_KIND, sealed.SEAL: _checksum_of_names(members), "recipe": words})
    try:
        with replace(path) as scratch, ZipFile(scratch, "w") as archive:
            for name in sorted(members):
                # ZipInfo dates every file 1980, so the bytes do not depend on the clock
                archive.writestr(ZipInfo(name), members[name].to_bytes())
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_model(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a model's named arrays; raises ArtifactError if the file is missing or damaged."""
    with open_model(path) as arrays:
        return {name: np.asarray(array[...]) for name, array in arrays.items()}


@contextmanager
def open_model(path: str | Path) -> Iterator[dict[str, Any]]:
    """Open a model's named arrays, each read when it is asked for; raises as `read_model`."""
    import zarr
    from zarr.storage import ZipStore

    read_recipe(path)
    with _damage_as_artifact_error(path), ZipStore(path, mode="r") as zip_store:
        members = zarr.open_group(zip_store, mode="r").members(max_depth=None)
        yield {name: array for name, array in members if isinstance(array, zarr.Array)}


def read_recipe(path: str | Path) -> dict[str, str]:
    """Read the parameters that a model was learned with; raises as `read_model`."""
    with _damage_as_artifact_error(path), ZipFile(path) as archive:
        attrs = json.loads(archive.read("zarr.json"))["attributes"]
        recipe: dict[str, str] = attrs.pop("recipe")
        if attrs != {**MODEL_KIND, sealed.SEAL: _checksum_of_names(archive.namelist())}:
            raise ValueError("its files are not those that were written")
    return recipe


@contextmanager
def _damage_as_artifact_error(path: str | Path) -> Iterator[None]:
    """Raise ArtifactError where a model's file is missing, or the block finds it damaged."""
    # zipfile compares a checksum of each file that the block reads, so contents need no check
    if not Path(path).exists():
        raise ArtifactError(f"{path}: no such model; `dvc repro` trains it")
    if Path(path).is_dir():
        raise ArtifactError(f"{path}: a folder, expected a model in one file")
    try:
        yield
    except Exception as error:  # zipfile and zarr may raise anything at a damaged file
        first_line, *_ = str(error).splitlines() or [type(error).__name__]
        reason = first_line[:120]
        raise ArtifactError(f"{path}: not a whole model ({reason}); {sealed.REBUILD}") from None


def _checksum_of_names(names: Iterable[str]) -> int:
    """The checksum of the names of a model's files, by which a missing file is noticed."""
    return crc32("\n".join(sorted(names)).encode())


def _flat(instance: Any) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """All arrays of a dataclass by name, and its attributes as JSON can hold them."""
    fields = define(type(instance))
    arrays = {name: np.asarray(getattr(instance, name)) for name in fields.arrays}
    attrs = {name: _encoded(getattr(instance, name)) for name in fields.attributes}
    for name in fields.stacks:
        flat_items = [_flat(item) for item in getattr(instance, name)]
        arrays_of_items = [item_arrays for item_arrays, _ in flat_items]
        for array_name in arrays_of_items[0]:
            arrays[array_name] = np.stack(
                [item_arrays[array_name] for item_arrays in arrays_of_items]
            )
        _, first_attrs = flat_items[0]
        attrs |= first_attrs
    return arrays, attrs


def _built(cls: type, arrays: Mapping[str, NDArray[Any]], attrs: Mapping[str, Any]) -> Any:
    """Build a dataclass from its arrays and attributes: `_flat` the other way round."""
    fields = define(cls)
    values: dict[str, Any] = {name: arrays[name] for name in fields.arrays}
    for name, (attribute_type, _) in fields.attributes.items():
        values[name] = _decoded(attribute_type, attrs[name])
    for name, (_, item_type) in fields.stacks.items():
        columns = {column: arrays[column] for column in define(item_type).columns}
        first_column = next(iter(columns.values()))
        values[name] = tuple(
            _built(item_type, {column: rows[i] for column, rows in columns.items()}, attrs)
            for i in range(len(first_column))
        )
    return cls(**values)


class _StackedItems(Sequence[Any]):
    """The stacked dataclasses of an artifact on disk, each of which is read when it is used."""

    def __init__(self, artifact: Artifact, item_type: type) -> None:
        self._artifact = artifact
        self._item_type = item_type
        self._columns = tuple(define(item_type).columns)
        """The names of the columns that the items are stored in."""

    def __len__(self) -> int:
        first_column, *_ = self._columns
        return len(self._artifact[first_column])

    def __getitem__(self, i: Any) -> Any:
        if not -len(self) <= i < len(self):
            raise IndexError(i)
        arrays = {name: np.asarray(self._artifact[name][i]) for name in self._columns}
        return _built(self._item_type, arrays, self._artifact.attrs)


def _encoded(value: Any) -> Any:
    """The value of an attribute as JSON can hold it: NaN becomes null."""
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, Mapping):
        return {key: _encoded(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_encoded(inner) for inner in value]
    return value


def _decoded(value_type: Any, value: Any) -> Any:
    """The value of an attribute from JSON, in the type of its field: null becomes NaN."""
    if value_type is float:
        return np.nan if value is None else float(value)
    inner_types = get_args(value_type)
    if get_origin(value_type) is tuple:
        item_type, *_ = inner_types  # all items of a tuple are of the first one's type
        return tuple(_decoded(item_type, inner) for inner in value)
    if get_origin(value_type) is abc.Mapping:
        _, item_type = inner_types
        return {key: _decoded(item_type, inner) for key, inner in value.items()}
    return value
