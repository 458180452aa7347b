"""Unpacks an untrusted .tar.gz into a folder: all of it, or nothing.

An archive is refused if it holds a link, a device or a path outside the folder, or if it unpacks to
more than the disk has room for.
"""

import gzip
import re
import shutil
import tarfile
import zlib
from pathlib import Path

from pipeline.core.errors import LogError

MAX_HEADER_BYTES = 2**20
"""Limit for the header of a member: a longer one is an attack on the memory."""
MAX_ENTRIES = 10**6
"""Limit for the members of an archive."""
MAX_PADDING_READS = 2**20
"""Limit for the reads of MAX_HEADER_BYTES behind the members of an archive, a terabyte in all."""


def unpack(path: Path, folder: Path, target: str) -> int:
    """Unpack `target`, and all that lies beside it in the archive, into `folder`.

    Returns the number of files in the archive. The archive is unpacked into a scratch folder beside
    it, and its content moved, `target` last: once that exists, everything does. Raises LogError for
    a damaged archive, which is removed, and for one that is refused.
    """
    scratch = path.with_name(path.name + ".unpacking")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir()
    try:
        file_count = _extract(path, scratch)
        places = sorted(scratch.rglob(target), key=lambda place: len(place.parts))
        if not places:
            raise LogError(f"{path}: holds no {target}; it is not the archive it should be")
        entries = sorted(places[0].parent.iterdir())
        entries.sort(key=lambda entry: entry.name == target)  # the target last
        for entry in entries:
            if (folder / entry.name).is_dir():
                raise LogError(
                    f"{folder / entry.name}: is in the way of what {path.name} holds; move it "
                    "elsewhere"
                )
            entry.replace(folder / entry.name)
        return file_count
    except (
        EOFError,
        ValueError,
        OverflowError,
        RecursionError,
        zlib.error,
        gzip.BadGzipFile,
        tarfile.TarError,
    ) as error:
        path.unlink()
        raise LogError(f"{path}: damaged ({error}), and removed; fetch it again") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be unpacked ({error.strerror})") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


class Stream(gzip.GzipFile):
    """The unpacked bytes of an archive, for tarfile.

    tarfile itself would read a header of any claimed length into memory.
    """

    def read(self, size: int | None = -1) -> bytes:
        if size is None or not 0 <= size <= MAX_HEADER_BYTES:
            raise tarfile.ReadError(f"a header of {size} bytes")
        return super().read(size)


def _extract(path: Path, scratch: Path) -> int:
    """Extract every member into `scratch`, verify gzip's checksum, and return the file count."""
    free_bytes = shutil.disk_usage(scratch).free
    unpacked_bytes = 0
    entry_count = 0
    file_count = 0
    with Stream(path) as stream, tarfile.open(fileobj=stream, mode="r:") as tar:
        while (member := tar.next()) is not None:
            tar.members = []  # type: ignore[attr-defined]  # or they would accumulate
            _refuse_odd(path, member)
            unpacked_bytes += member.size
            entry_count += 1
            file_count += member.isreg()
            if unpacked_bytes > free_bytes or entry_count > MAX_ENTRIES:
                raise LogError(
                    f"{path}: unpacks to more than the {free_bytes / 1e9:.1f} GB free here or to a "
                    "million files; refused"
                )
            _write_member(tar, member, scratch / member.name)
        # gzip verifies the checksum at the end of the stream, behind the padding of the tar
        for _ in range(MAX_PADDING_READS):
            if not stream.read(MAX_HEADER_BYTES):
                return file_count
    raise LogError(f"{path}: a terabyte of nothing behind its members; refused")


def _write_member(tar: tarfile.TarFile, member: tarfile.TarInfo, target: Path) -> None:
    """Write the content of a checked member to `target`."""
    # `tar.extract` has safe filters only after Python 3.11.2
    if member.isdir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    source = tar.extractfile(member)
    if source is None:
        raise tarfile.ReadError(f"{member.name[:100]!r} has no content")
    with source, target.open("wb") as file:
        shutil.copyfileobj(source, file)


def _refuse_odd(path: Path, member: tarfile.TarInfo) -> None:
    """Raise LogError for a member with a path outside its folder, a link or a device."""
    parts = re.split(r"[/\\]", member.name)
    if member.name.startswith(("/", "\\")) or ".." in parts or ":" in parts[0]:
        raise LogError(
            f"{path}: would write to {member.name[:100]!r}, outside its folder; refused, nothing "
            "was unpacked"
        )
    if not (member.isreg() or member.isdir()) or member.size < 0:
        raise LogError(
            f"{path}: {member.name[:100]!r} is a link or a device, not a file; refused, nothing "
            "was unpacked"
        )
