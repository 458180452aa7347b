"""Artifacts on disk, written whole or not at all: zarr groups of a declared kind, and models.

A kind of artifact is a frozen dataclass (pipeline/core/schemas.py): its fields say what each array
and each attribute is, and are how it is read and written.

A model is a zarr group too, of arrays by any names, and lies in one zip: a network has some two
hundred arrays, and each would be a folder.
"""

import json
import math
from collections import abc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from dataclasses import replace as changed
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
from pipeline.core.replacing import replace as replace

if TYPE_CHECKING:  # a robot that localises in a site reads no artifact
    import zarr
    from zarr.abc.buffer import Buffer

MODEL = ".zarr.zip"
"""How the file of a model ends."""
MODEL_KIND = {"kind": "model", "version": 1}


@dataclass(frozen=True)
class Array:
    """Describes an array of an artifact: `Annotated[NDArray[np.float32], Array(...)]`."""

    dims: tuple[str, ...]
    """One name a dimension, rows first. Dimensions of one name have one length within an artifact;
    `scan+1` marks an array of offsets, one longer than its scans."""
    says: str
    """What a number in it means."""
    unit: str = ""
    """Of its numbers, as xarray shows it; empty for counts, indices and shares."""
    chunk: int = 65_536
    """Rows read and compressed together."""
    shard: int = 4_194_304
    """Rows in one file; a multiple of `chunk`."""
    dtype: str = ""
    """Such as float32, as the field is annotated."""


@dataclass(frozen=True)
class Stack:
    """Describes a sequence of dataclasses whose arrays lie along a further first dimension.

    `Annotated[Sequence[Judgement], Stack("protocol")]`; each is read by itself, and their
    attributes are those of the first.
    """

    dim: str
    chunk: int = 1
    shard: int = 64


@dataclass(frozen=True)
class Definition:
    """What the annotated fields of a dataclass say."""

    arrays: Mapping[str, Array]
    attributes: Mapping[str, tuple[Any, str]]
    """Type and meaning of each."""
    stacks: Mapping[str, tuple[Stack, type]]
    """How they lie, and the type of one of them."""

    @property
    def columns(self) -> dict[str, Array]:
        """All arrays by name, those of stacked dataclasses with the further dimension."""
        columns = dict(self.arrays)
        for stack, part in self.stacks.values():
            for name, array in definition(part).columns.items():
                dims = (stack.dim, *array.dims)
                columns[name] = changed(array, dims=dims, chunk=stack.chunk, shard=stack.shard)
        return columns

    @property
    def meanings(self) -> dict[str, str]:
        """All attributes by name, those of stacked dataclasses too."""
        meanings = {name: meaning for name, (_, meaning) in self.attributes.items()}
        for _, part in self.stacks.values():
            meanings |= definition(part).meanings
        return meanings


def definition(cls: type) -> Definition:
    """Read a dataclass's definition off its annotations."""
    arrays = {}
    attributes = {}
    stacks = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            continue
        field_type, meaning = get_args(hint)
        if isinstance(meaning, Array):
            last = get_args(field_type)[-1]  # dtype[float32]; float32 itself since numpy 2.5
            scalar = (get_args(last) or (last,))[0]
            arrays[name] = changed(meaning, dtype=np.dtype(scalar).name)
        elif isinstance(meaning, Stack):
            stacks[name] = (meaning, get_args(field_type)[0])
        else:
            attributes[name] = (field_type, meaning)
    return Definition(arrays, attributes, stacks)


class Artifact:
    """One kind of artifact: a zarr group of arrays and attributes.

    A kind is a frozen dataclass whose fields are annotated with `Array` (an array), a sentence (an
    attribute) or `Stack`. An artifact is made of its fields, or read: then `artifact.column` is
    read whole when it is first asked for, and `artifact["column"]` is an array to be sliced.
    """

    kind: ClassVar[str]
    version: ClassVar[int]
    definition: ClassVar[Definition]
    columns: ClassVar[Mapping[str, Array]]
    attributes: ClassVar[Mapping[str, str]]
    """What each attribute means."""
    path: Path | str = ""
    """Where it was read from; empty if it was not."""
    _group: Any = None
    _stored_attrs: dict[str, Any]

    def __init_subclass__(cls, kind: str = "", version: int = 0) -> None:
        cls.kind = kind
        cls.version = version
        cls.definition = definition(cls)
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
        """All arrays by name, as they are written."""
        arrays, _ = _flat(self)
        return arrays

    def __getitem__(self, name: str) -> Any:
        if self._group is None:
            return self.arrays[name]
        return sealed.Stored(self.path, self._group[name])

    def load(self, name: str) -> NDArray[Any]:
        """A whole column as an array."""
        return np.asarray(self[name][:])

    @classmethod
    def _opened(cls, path: Path | str, group: "zarr.Group") -> Self:
        """The artifact in a group, whose arrays are yet to be read."""
        artifact = cls.__new__(cls)
        artifact.__dict__["path"] = path
        artifact.__dict__["_group"] = group
        artifact.__dict__["_stored_attrs"] = {
            name: value for name, value in group.attrs.items() if name != sealed.SEAL
        }
        return artifact

    if not TYPE_CHECKING:  # a mistyped field is a type error

        def __getattr__(self, name: str) -> Any:
            """Read a field when it is first asked for."""
            fields = self.definition
            if name in fields.arrays:
                value = self.load(name)
            elif name in fields.attributes:
                value = _decoded(fields.attributes[name][0], self._stored_attrs[name])
            elif name in fields.stacks:
                value = _Parts(self, fields.stacks[name][1])
            else:
                raise AttributeError(name)
            self.__dict__[name] = value
            return value


A = TypeVar("A", bound=Artifact)


def read(path: str | Path, *kinds: type[A]) -> A:
    """Open an artifact in a folder, or in an object store as s3://BUCKET/PATH.

    Raises ArtifactError if it is missing or not of one of the kinds, in its version.
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
    stored = (group.attrs.get("kind"), group.attrs.get("version"))
    for kind in kinds:
        if stored == (kind.kind, kind.version):
            sealed.check_metadata(path, group)
            return kind._opened(path if remote.is_remote(path) else Path(path), group)
    expected = " or ".join(f"{kind.kind} version {kind.version}" for kind in kinds)
    raise ArtifactError(
        f"{path}: expected {expected}, found {stored[0]} version {stored[1]}; `dvc repro` builds "
        "it anew"
    )


def write(path: str | Path, artifact: Artifact) -> None:
    """Write an artifact that is whole in memory."""
    arrays, attrs = _flat(artifact)
    with draft(path, type(artifact), **attrs) as out:
        for name, rows in arrays.items():
            out.put(name, rows)


@contextmanager
def draft(path: str | Path, kind: type[Artifact], **attrs: object) -> Iterator["Draft"]:
    """Draft an artifact, which appears at `path` only if the block ends well and fits its kind.

    An attribute that is known only at the end may be a callable without arguments.
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
        self._arrays: dict[str, Any] = {}

    def put(self, name: str, rows: NDArray[Any]) -> None:
        """Write the column `name` whole, once.

        Floats may be rounded to the kind's type, integers must fit.
        """
        if name in self._waiting:
            raise ArtifactError(f"{self._kind.kind}.{name}: written already")
        self.append(name, rows)

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Write the next rows of column `name`, a whole shard at a time.

        Unaligned shard writes corrupt (zarr #3682).
        """
        column = self._column(name)
        rows = np.asarray(rows)
        if rows.ndim != len(column.dims) or not np.can_cast(rows.dtype, column.dtype, "same_kind"):
            raise ArtifactError(
                f"{self._kind.kind}.{name}: {rows.dtype}{rows.shape} does not fit "
                f"{column.dtype}{column.dims}"
            )
        cast = rows.astype(column.dtype, copy=False)
        if cast.dtype.kind in "iu" and (cast != rows).any():
            raise ArtifactError(f"{self._kind.kind}.{name}: a value does not fit {column.dtype}")
        waiting_rows = self._waiting.setdefault(name, [])
        waiting_rows.append(cast)
        if sum(map(len, waiting_rows)) >= column.shard:
            joined = np.concatenate(waiting_rows)
            whole_rows = len(joined) // column.shard * column.shard
            self._write(name, column, joined[:whole_rows])
            self._waiting[name] = [joined[whole_rows:]]

    def finish(self, attrs: Mapping[str, object]) -> None:
        """Write what waits, set the attributes and check the whole against the kind."""
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
        """Write the checksum of the metadata, once nothing follows."""
        self._group.attrs[sealed.SEAL] = sealed.metadata_checksum(path)

    def _column(self, name: str) -> Array:
        if name not in self._kind.columns:
            raise ArtifactError(f"{self._kind.kind} has no column {name}")
        return self._kind.columns[name]

    def _write(self, name: str, column: Array, rows: NDArray[Any]) -> None:
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
    """Write named arrays as a zarr group in one zip; equal models have equal bytes.

    The group's attribute `recipe` has the parameters that they were learned with, as texts.
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
    group.attrs.update({**MODEL_KIND, sealed.SEAL: _checksum(members), "recipe": words})
    try:
        with replace(path) as scratch, ZipFile(scratch, "w") as archive:
            for name in sorted(members):
                archive.writestr(ZipInfo(name), members[name].to_bytes())  # dated 1980, all of them
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_model(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a model's named arrays; raises ArtifactError if the file is missing or damaged."""
    import zarr
    from zarr.storage import ZipStore

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


def _flat(part: Any) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """All arrays of a dataclass, and its attributes as JSON can hold them."""
    fields = definition(type(part))
    arrays = {name: np.asarray(getattr(part, name)) for name in fields.arrays}
    attrs = {name: _encoded(getattr(part, name)) for name in fields.attributes}
    for name in fields.stacks:
        flat_parts = [_flat(inner) for inner in getattr(part, name)]
        inner_arrays, inner_attrs = flat_parts[0]
        arrays |= {key: np.stack([flat[0][key] for flat in flat_parts]) for key in inner_arrays}
        attrs |= inner_attrs
    return arrays, attrs


def _part(cls: type, arrays: Mapping[str, NDArray[Any]], attrs: Mapping[str, Any]) -> Any:
    """A dataclass from its arrays and attributes."""
    fields = definition(cls)
    values: dict[str, Any] = {name: arrays[name] for name in fields.arrays}
    for name, (attribute_type, _) in fields.attributes.items():
        values[name] = _decoded(attribute_type, attrs[name])
    for name, (_, part) in fields.stacks.items():
        columns = {column: arrays[column] for column in definition(part).columns}
        count = len(next(iter(columns.values())))
        values[name] = tuple(
            _part(part, {column: rows[i] for column, rows in columns.items()}, attrs)
            for i in range(count)
        )
    return cls(**values)


class _Parts(Sequence[Any]):
    """The stacked dataclasses of an artifact, each read when it is asked for."""

    def __init__(self, artifact: Artifact, part: type) -> None:
        self._artifact = artifact
        self._part = part

    def __len__(self) -> int:
        return len(self._artifact[next(iter(definition(self._part).columns))])

    def __getitem__(self, i: Any) -> Any:
        if not -len(self) <= i < len(self):
            raise IndexError(i)
        arrays = {
            name: np.asarray(self._artifact[name][i]) for name in definition(self._part).columns
        }
        return _part(self._part, arrays, self._artifact.attrs)


def _encoded(value: Any) -> Any:
    """A value of an attribute as JSON can hold it: NaN is null."""
    if isinstance(value, float) and math.isnan(value):
        return None
    if isinstance(value, Mapping):
        return {key: _encoded(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_encoded(inner) for inner in value]
    return value


def _decoded(value_type: Any, value: Any) -> Any:
    """A value of an attribute from JSON, as its field is annotated."""
    if value_type is float:
        return np.nan if value is None else float(value)
    inner_types = get_args(value_type)
    if get_origin(value_type) is tuple:
        return tuple(_decoded(inner_types[0], inner) for inner in value)
    if get_origin(value_type) is abc.Mapping:
        return {key: _decoded(inner_types[1], inner) for key, inner in value.items()}
    return value
