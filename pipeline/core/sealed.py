"""Checks the checksums of artifacts, so that damaged bytes are never read as numbers.

An artifact is a zarr group of arrays in chunks. Each chunk ends in a checksum of its own, written
by zstd; the metadata of the group and its arrays have one in the group's attribute `seal`. `store`
writes and reads artifacts through this module.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

from pipeline.core.errors import ArtifactError
from pipeline.core.remote import content, matching_files

if TYPE_CHECKING:  # a robot that localises in a site reads no artifact
    import zarr
    from zarr.codecs import ZstdCodec

SEAL = "seal"
"""The attribute with the checksum of the metadata."""
REBUILD = "remove it and `dvc repro` it"
"""The advice in errors about a damaged artifact."""
ALL_CHUNKS = {"write_empty_chunks": True}
"""Option of zarr: chunks of zeros are written too, so that a missing file always means damage."""


def compressor() -> "ZstdCodec":
    """The codec of all chunks, which adds a checksum."""
    from zarr.codecs import ZstdCodec

    return ZstdCodec(level=0, checksum=True)


class StoredArray:
    """An array of an artifact on disk, read by slices like a numpy array.

    Raises ArtifactError if bytes are damaged or missing.
    """

    def __init__(self, path: Path | str, array: Any) -> None:
        """`path` is the artifact's, `array` the zarr array in it."""
        self._path = path
        self._array = array
        file_shape = array.shards or array.chunks
        lengths = zip(array.shape, file_shape, strict=True)
        expected = math.prod(-(-length // part) for length, part in lengths)  # rounded up
        missing = expected - len(matching_files(path, f"{array.basename}/c.*"))
        if missing > 0:
            raise ArtifactError(
                f"{path}: {missing} of {expected} files of {array.basename} are missing; {REBUILD}"
            )

    def __getitem__(self, rows: Any) -> Any:
        try:
            return self._array[rows]
        except (IndexError, MemoryError, OSError):  # no damage: wrong rows, or the machine refuses
            raise
        except Exception as error:  # zarr and its codecs may raise anything at a damaged chunk
            first_line, *_ = str(error).splitlines() or ["no reason given"]
            reason = f"{type(error).__name__}: {first_line[:120]}"
            raise ArtifactError(
                f"{self._path}: {self._array.basename} is damaged ({reason}); {REBUILD}"
            ) from None

    def __len__(self) -> int:
        return int(self._array.shape[0])

    def __getattr__(self, name: str) -> Any:
        """Everything else, such as `shape`, is the zarr array's own."""
        return getattr(self._array, name)


def metadata_checksum(path: Path | str) -> int:
    """The checksum of the zarr.json of a group, without the seal, and those of its arrays."""
    metadata = json.loads(content(f"{path}/zarr.json"))
    metadata["attributes"].pop(SEAL, None)
    array_metadata = [content(file) for file in matching_files(path, "*/zarr.json")]
    return crc32(b"".join([json.dumps(metadata, sort_keys=True).encode(), *array_metadata]))


def check_metadata(path: Path | str, group: "zarr.Group") -> None:
    """Raise ArtifactError unless a group's metadata are as they were written."""
    if group.attrs.get(SEAL) != metadata_checksum(path):
        raise ArtifactError(f"{path}: its zarr.json are not as they were written; {REBUILD}")
