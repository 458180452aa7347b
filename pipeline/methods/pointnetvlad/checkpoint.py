"""Reads a TensorFlow checkpoint without TensorFlow: the files `PREFIX.index` and `PREFIX.data-…`.

In: the path PREFIX. Out: all tensors as arrays, by name. The index is a LevelDB table: blocks of
sorted keys with their values, and a footer. A key is stored without the prefix that it shares with
the previous key. The values are protobuf messages: under the empty key a header; under each
tensor's name its type, shape, shard, offset and size. The data files (shards) hold the raw numbers.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError

FOOTER_BYTES = 48
MAGIC = 0xDB4775248B80FB57
"""The last eight bytes of a LevelDB table."""
TYPES: Mapping[int, type[np.generic]] = {
    1: np.float32,
    2: np.float64,
    3: np.int32,
    9: np.int64,
}
"""Number types by TensorFlow's enum DataType; tensors of other types are skipped."""
Message = dict[int, list[int | bytes]]
"""A protobuf message: field number to the field's values in order, each a number, or bytes."""


class Entry(NamedTuple):
    """The index's entry for a tensor."""

    dtype_code: int
    """A key of TYPES, unless the tensor is skipped."""
    shape: tuple[int, ...]
    shard: int
    """The number of the data file."""
    offset: int
    """Where the tensor begins in that file, in bytes."""
    size: int
    """The length of the tensor in bytes."""


def is_checkpoint(prefix: Path) -> bool:
    """Whether a path is the common beginning of a checkpoint's files."""
    return index_path(prefix).is_file()


def index_path(prefix: Path) -> Path:
    """The file that names a checkpoint's tensors."""
    return prefix.with_name(f"{prefix.name}.index")


def read_checkpoint(prefix: Path) -> dict[str, NDArray[Any]]:
    """All tensors of a checkpoint by name.

    Raises ConfigError, which names the file, if a file is missing, cut short or no such table.
    """
    path = index_path(prefix)
    try:
        messages = dict(_entries(path.read_bytes()))
        header = messages.pop("")  # BundleHeaderProto, whose first field is the number of shards
        shards = int(header.get(1, [1])[0])
        tensor_entries = {name: _entry(message) for name, message in messages.items()}
    except (IndexError, KeyError, TypeError, UnicodeDecodeError, ValueError) as error:
        raise ConfigError(
            f"{path}: no index of a TensorFlow checkpoint ({error}); correct method.weights"
        ) from None
    arrays = {}
    for name, entry in tensor_entries.items():
        if entry.dtype_code in TYPES:
            arrays[name] = _tensor(prefix, shards, name, entry)
    return arrays


def _tensor(prefix: Path, shards: int, name: str, entry: Entry) -> NDArray[Any]:
    """Read a tensor from its data file; `shards` is the number of data files."""
    path = prefix.with_name(f"{prefix.name}.data-{entry.shard:05d}-of-{shards:05d}")
    dtype = np.dtype(TYPES[entry.dtype_code]).newbyteorder("<")
    count = int(np.prod(entry.shape, dtype=np.int64))
    if entry.size != count * dtype.itemsize:
        raise ConfigError(
            f"{path}: tensor {name} of shape {entry.shape} has {entry.size} bytes, expected "
            f"{count * dtype.itemsize}; fetch the checkpoint again"
        )
    try:
        return np.fromfile(path, dtype, count, offset=entry.offset).reshape(entry.shape)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; it belongs to {index_path(prefix)}") from None
    except ValueError:
        raise ConfigError(
            f"{path}: ends before tensor {name}; it is cut short: fetch the checkpoint again"
        ) from None


def _entry(message: Message) -> Entry:
    """The entry of a tensor: BundleEntryProto of 1 dtype, 2 shape, 3 shard, 4 offset, 5 size."""
    shape_message = _message(_bytes(message.get(2, [b""])[0]))
    dimensions = [_message(_bytes(dimension)) for dimension in shape_message.get(2, [])]
    return Entry(
        dtype_code=_number(message, 1),
        shape=tuple(_number(dimension, 1) for dimension in dimensions),
        shard=_number(message, 3),
        offset=_number(message, 4),
        size=_number(message, 5),
    )


def _number(message: Message, field: int) -> int:
    """The first value of a field; 0, protobuf's default, if it is missing."""
    return int(message.get(field, [0])[0])


def _entries(table: bytes) -> Iterator[tuple[str, Message]]:
    """The keys and values of a table, whose footer says where the index of its blocks is."""
    if len(table) < FOOTER_BYTES or int.from_bytes(table[-8:], "little") != MAGIC:
        raise ValueError("it does not end as a table does")
    footer = table[-FOOTER_BYTES:]
    # The first handle is the metaindex block's, which TensorFlow leaves empty; the second is the
    # index block's.
    _, at = _handle(footer, 0)
    index, _ = _handle(footer, at)
    for _, value in _block(table, *index):
        block, _ = _handle(value, 0)
        for key, entry in _block(table, *block):
            yield key.decode("utf-8"), _message(entry)


def _handle(data: bytes, at: int) -> tuple[tuple[int, int], int]:
    """The offset and size of a block in bytes, read at `at`, and the position after them."""
    offset, at = _varint(data, at)
    size, at = _varint(data, at)
    return (offset, size), at


def _block(table: bytes, offset: int, size: int) -> Iterator[tuple[bytes, bytes]]:
    """The keys and values of a block.

    A key is stored without the prefix that it shares with the previous key.
    """
    if table[offset + size] != 0:  # the byte after a block is its kind of compression
        raise ValueError("its blocks are compressed, which TensorFlow's are not")
    block = table[offset : offset + size]
    # A block ends with the offsets of the entries with whole keys (restarts), then the number of
    # these offsets, 4 bytes each.
    restarts = int.from_bytes(block[-4:], "little")
    end = size - 4 * (restarts + 1)
    at = 0
    key = b""
    while at < end:
        shared, at = _varint(block, at)
        unshared, at = _varint(block, at)
        length, at = _varint(block, at)
        key = key[:shared] + block[at : at + unshared]
        yield key, block[at + unshared : at + unshared + length]
        at += unshared + length


def _message(data: bytes) -> Message:
    """The fields of a protobuf message; each begins with its number and its wire type."""
    fields: Message = {}
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)  # the number, then three bits of the wire type
        wire_type = tag & 7
        value: int | bytes
        if wire_type == 0:
            value, at = _varint(data, at)
        elif wire_type == 2:
            length, at = _varint(data, at)
            value = data[at : at + length]
            at += length
        elif wire_type in (1, 5):
            length = 8 if wire_type == 1 else 4
            value = int.from_bytes(data[at : at + length], "little")
            at += length
        else:
            raise ValueError(f"a field of wire type {wire_type}")
        fields.setdefault(tag >> 3, []).append(value)
    return fields


def _bytes(value: int | bytes) -> bytes:
    """A value that should be bytes; raises TypeError for a number."""
    if isinstance(value, int):
        raise TypeError("a number where a message was expected")
    return value


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number that is stored in seven bits per byte, and the position after it."""
    value = shift = 0
    while data[at] & 0x80:
        value |= (data[at] & 0x7F) << shift
        shift += 7
        at += 1
    return value | data[at] << shift, at + 1
