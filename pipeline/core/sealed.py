"""Checksums of chunks and of metadata, so that damaged bytes are never read as numbers.

A chunk ends in zstd's own checksum; the metadata of a zarr group and of its arrays have one in the
group's attribute `seal`.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

from pipeline.core.errors import ArtifactError
from pipeline.core.remote import content, listed

if TYPE_CHECKING:  # a robot that localises in a site reads no artifact
    import zarr
    from zarr.codecs import ZstdCodec

SEAL = "seal"
REBUILD = "remove it and `dvc repro` it"
ALL_CHUNKS = {"write_empty_chunks": True}
"""Chunks of zeros are written too, so that a file that is not there always means damage."""


def compressor() -> "ZstdCodec":
    """The codec of all chunks, which adds a checksum."""
    from zarr.codecs import ZstdCodec

    return ZstdCodec(level=0, checksum=True)


class Stored:
    """An array of an artifact, read by slices.

    Raises ArtifactError where bytes are damaged or missing.
    """

    def __init__(self, path: Path | str, array: Any) -> None:
        self._path = path
        self._array = array
        files = math.prod(
            -(-length // part)
            for length, part in zip(array.shape, array.shards or array.chunks, strict=True)
        )
        if (file_count := len(listed(path, f"{array.basename}/c.*"))) < files:
            raise ArtifactError(
                f"{path}: {files - file_count} of {files} files of {array.basename} are missing; "
                f"{REBUILD}"
            )

    def __getitem__(self, rows: Any) -> Any:
        try:
            return self._array[rows]
        except (IndexError, MemoryError, OSError):
            raise
        except Exception as error:  # zarr and its codecs may raise anything at a damaged chunk
            reason = (
                f"{type(error).__name__}: "
                f"{(str(error).splitlines() or ['no reason given'])[0][:120]}"
            )
            raise ArtifactError(
                f"{self._path}: {self._array.basename} is damaged ({reason}); {REBUILD}"
            ) from None

    def __len__(self) -> int:
        return int(self._array.shape[0])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._array, name)


def metadata_checksum(path: Path | str) -> int:
    """The checksum of the metadata of a group and its arrays."""
    metadata = json.loads(content(f"{path}/zarr.json"))
    metadata["attributes"].pop(SEAL, None)
    array_metadata = [content(file) for file in listed(path, "*/zarr.json")]
    return crc32(b"".join([json.dumps(metadata, sort_keys=True).encode(), *array_metadata]))


def check_metadata(path: Path | str, group: "zarr.Group") -> None:
    """Raise ArtifactError unless the metadata are as they were written."""
    if group.attrs.get(SEAL) != metadata_checksum(path):
        raise ArtifactError(f"{path}: its zarr.json are not as they were written; {REBUILD}")
