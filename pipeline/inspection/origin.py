"""The provenance of a file: dvc.lock in; for `yearloc inspect`, the stage that wrote the file out.

And whether the file is still as that stage wrote it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.inspection.inspection import Inspection, nbytes
from pipeline.running.dvc_files import DvcLock, LockedFile, LockEntry


def add_provenance(inspection: Inspection, path: Path, lock: Path, is_artifact: bool) -> None:
    """Add the stage that wrote `path`, or the folder around it: its cmd, parameters and
    dependencies.

    Raw files without an entry in the lock get no section. An artifact with another number of files
    or bytes than the lock recorded gets a warning, before all others: zarr reads a lost shard as
    zeros.
    """
    try:
        relative_path = path.resolve().relative_to(lock.resolve().parent)
    except ValueError:
        relative_path = path
    entry = DvcLock.read(lock).entry(relative_path)
    if entry is not None:
        inspection.add("provenance", *_rows(entry))
    elif is_artifact:
        by_hand = (
            f"{lock} has no entry for it: it was written by hand or by a sweep, not by `dvc repro`"
        )
        inspection.add(
            "provenance", ("unknown", by_hand if lock.is_file() else f"there is no {lock}")
        )
    outs = {out.path: out for out in entry.outs} if entry else {}
    out = outs.get(relative_path.as_posix())
    if not is_artifact or out is None or out.size is None:
        return
    files = sum(1 for file in path.rglob("*") if file.is_file()) if path.is_dir() else 1
    nbytes_on_disk = size(path)
    if (files, nbytes_on_disk) != (out.file_count, out.size):
        recorded = f"{out.file_count} with {out.size:,}"
        remedy = (
            "a lost one reads as zeros: remove the artifact and `dvc checkout` it, or `dvc repro`"
        )
        warning = (
            f"not what {lock} recorded: {files} files with {nbytes_on_disk:,} bytes, recorded "
            f"{recorded}; {remedy}"
        )
        inspection.warnings = (warning, *inspection.warnings)


def _settings(values: Mapping[str, Any]) -> str:
    """The settings of a file that have a value."""
    return ", ".join(
        f"{key}={short(value)}" for key, value in values.items() if _is_set(key, value)
    )


def _rows(entry: LockEntry) -> list[tuple[str, str]]:
    """Stage, command, parameters, inputs and code, each in one row or several."""
    params = [
        f"{file}: {_settings(values) or 'nothing set'}" for file, values in entry.params.items()
    ]
    code = [dep.path for dep in entry.deps if dep.path.startswith(("pipeline", "stages"))]
    data = [f"{dep.path} ({_digest(dep)})" for dep in entry.deps if dep.path not in code]
    rows = [("stage", entry.stage), ("cmd", " ".join(entry.command.split()))]
    rows += [
        (title if i == 0 else "", line)
        for title, lines in (("params", params), ("deps", data))
        for i, line in enumerate(lines)
    ]
    return rows + ([("code", ", ".join(code))] if code else [])


def size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return (
        sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        if path.is_dir()
        else path.stat().st_size
    )


def short(value: object) -> str:
    """The value of a parameter as one line of text."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(short(item) for item in value) + "]"
    if isinstance(value, dict):
        return (
            "{" + ", ".join(f"{key}: {short(item)}" for key, item in value.items()) + "}"
            if value
            else "none"
        )
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _is_set(key: str, value: object) -> bool:
    """Whether a key of a conf file holds a value.

    A null is set on the command line, and `defaults` names other files.
    """
    return value is not None and key != "defaults"


def _digest(dep: LockedFile) -> str:
    """Hash, size and files of a dependency."""
    count = f", {dep.file_count} files" if dep.is_folder else ""
    length = "" if dep.size is None else f", {nbytes(dep.size)}"
    return f"{dep.md5[:8]}{length}{count}"
