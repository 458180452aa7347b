"""Unpacks an untrusted .tar.gz, all of it or nothing.

Only plain files and folders are allowed, and only below the given folder.
"""

import gzip
import re
import shutil
import tarfile
import zlib
from pathlib import Path

from pipeline.core.errors import LogError

LARGEST_HEADER = 2**20
"""Limit in bytes for the header of a member: a longer one is an attack on the memory."""
MOST_ENTRIES = 10**6


class Stream(gzip.GzipFile):
    """The stream for tarfile, which would read a header of any claimed length into memory."""

    def read(self, size: int | None = -1) -> bytes:
        if size is None or not 0 <= size <= LARGEST_HEADER:
            raise tarfile.ReadError(f"a header of {size} bytes")
        return super().read(size)


def unpack(path: Path, folder: Path, target: str) -> int:
    """Unpack `target`, and all that lies beside it in the archive, into `folder`.

    Returns the number of files in the archive. The archive is unpacked beside itself and its
    content moved, `target` last: once that exists, everything does. Raises LogError for a damaged
    archive, which is removed, and for one with paths outside, links, devices, or more than the disk
    has room for.
    """
    scratch = path.with_name(path.name + ".unpacking")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir()
    try:
        files = _extract(path, scratch)
        places = sorted(scratch.rglob(target), key=lambda place: len(place.parts))
        if not places:
            raise LogError(f"{path}: holds no {target}; it is not the archive it should be")
        for entry in sorted(
            places[0].parent.iterdir(), key=lambda entry: (entry.name == target, entry.name)
        ):
            if (folder / entry.name).is_dir():
                raise LogError(
                    f"{folder / entry.name}: is in the way of what {path.name} holds; move it "
                    "elsewhere"
                )
            entry.replace(folder / entry.name)
        return files
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
        raise LogError(f"{path}: damaged ({error}), and removed; fetch it anew") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be unpacked ({error.strerror})") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _extract(path: Path, scratch: Path) -> int:
    """Extract every member into `scratch`, verify gzip's checksum, and return the file count."""
    free_bytes = shutil.disk_usage(scratch).free
    unpacked_bytes = 0
    entries = 0
    files = 0
    with Stream(path) as stream, tarfile.open(fileobj=stream, mode="r:") as tar:
        while (member := tar.next()) is not None:
            tar.members = []  # type: ignore[attr-defined]  # or they would accumulate
            _refuse_odd(path, member)
            unpacked_bytes = unpacked_bytes + member.size
            entries = entries + 1
            files = files + member.isreg()
            if unpacked_bytes > free_bytes or entries > MOST_ENTRIES:
                raise LogError(
                    f"{path}: unpacks to more than the {free_bytes / 1e9:.1f} GB free here or to a "
                    "million files; refused"
                )
            _place(tar, member, scratch / member.name)
        for _ in range(LARGEST_HEADER):  # gzip verifies the checksum at the end of the stream
            if not stream.read(LARGEST_HEADER):
                return files
    raise LogError(f"{path}: a terabyte of nothing behind its members; refused")


def _place(tar: tarfile.TarFile, member: tarfile.TarInfo, target: Path) -> None:
    """Write the content of a checked member to `target`.

    tarfile has filters of its own only after Python 3.11.2.
    """
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
