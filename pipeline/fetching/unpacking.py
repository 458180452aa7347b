"""Unpacking a .tar.gz that comes from elsewhere: only plain files and folders, only below the folder, all of it or nothing."""

import gzip
import re
import shutil
import tarfile
import zlib
from pathlib import Path

from pipeline.errors import LogError

LARGEST_HEADER = 2**20
"""A member's header; longer ones are made to fill the memory."""
MOST_ENTRIES = 10**6


class Stream(gzip.GzipFile):
    """What tarfile reads from; it takes a header at once, however long it claims to be."""

    def read(self, size: int | None = -1) -> bytes:
        if size is None or not 0 <= size <= LARGEST_HEADER:
            raise tarfile.ReadError(f"a header of {size} bytes")
        return super().read(size)


def unpack(path: Path, folder: Path, holds: str) -> int:
    """Unpack the archive into `folder` what stands beside `holds` in it, below whatever folders; returns how many files.

    It is unpacked beside itself and then moved, `holds` last: who finds that finds all. Raises LogError for a damaged archive,
    which is removed, and for one that would write elsewhere, holds links or devices, or more than the disk has room for.
    """
    scratch = path.with_name(path.name + ".unpacking")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir()
    try:
        files = _extract(path, scratch)
        found = sorted(scratch.rglob(holds), key=lambda place: len(place.parts))
        if not found:
            raise LogError(f"{path}: holds no {holds}; it is not the archive it should be")
        for entry in sorted(found[0].parent.iterdir(), key=lambda entry: (entry.name == holds, entry.name)):
            if (folder / entry.name).is_dir():
                raise LogError(f"{folder / entry.name}: is in the way of what {path.name} holds; move it elsewhere")
            entry.replace(folder / entry.name)
        return files
    except (EOFError, ValueError, OverflowError, RecursionError, zlib.error, gzip.BadGzipFile, tarfile.TarError) as error:
        path.unlink()
        raise LogError(f"{path}: damaged ({error}), and removed; fetch it anew") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be unpacked ({error.strerror})") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _extract(path: Path, scratch: Path) -> int:
    """Every member into `scratch`, and the archive's own checksum."""
    room, taken, entries, files = shutil.disk_usage(scratch).free, 0, 0, 0
    with Stream(path) as stream, tarfile.open(fileobj=stream, mode="r:") as tar:
        while (member := tar.next()) is not None:
            tar.members = []  # type: ignore[attr-defined]  # they would pile up
            _refuse_odd(path, member)
            taken, entries, files = taken + member.size, entries + 1, files + member.isreg()
            if taken > room or entries > MOST_ENTRIES:
                raise LogError(f"{path}: unpacks to more than the {room / 1e9:.1f} GB free here or to a million files; refused")
            _place(tar, member, scratch / member.name)
        for _ in range(LARGEST_HEADER):  # gzip checks what was read when it comes to its end
            if not stream.read(LARGEST_HEADER):
                return files
    raise LogError(f"{path}: a terabyte of nothing behind its members; refused")


def _place(tar: tarfile.TarFile, member: tarfile.TarInfo, target: Path) -> None:
    """Write a checked member, content alone: tarfile's own filters came after Python 3.11.2."""
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
        raise LogError(f"{path}: would write to {member.name[:100]!r}, outside its folder; refused, nothing was unpacked")
    if not (member.isreg() or member.isdir()) or member.size < 0:
        raise LogError(f"{path}: {member.name[:100]!r} is a link or a device, not a file; refused, nothing was unpacked")
