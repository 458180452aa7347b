"""Finds the provenance of a file for `yearloc inspect`: dvc.lock in; rows of text and warnings out.

The rows name the stage that wrote the file, its command, parameters and inputs. A warning says if
the file is no longer as that stage wrote it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.inspection.inspection import Inspection, nbytes
from pipeline.running.dvc_files import DvcLock, LockedFile, LockEntry


def add_provenance(inspection: Inspection, path: Path, lock: Path, is_artifact: bool) -> None:
    """Add the stage that wrote `path`, or the folder around it, by the entry in the `lock`.

    A raw file without an entry gets no section. An artifact that differs from its entry in size or
    number of files gets a warning, placed before all others, since zarr reads a lost file as zeros.
    """
    try:
        relative_path = path.resolve().relative_to(lock.resolve().parent)
    except ValueError:
        relative_path = path
    entry = DvcLock.read(lock).entry(relative_path)
    if entry is not None:
        inspection.add("provenance", *_rows(entry))
    elif is_artifact:
        reason = f"there is no {lock}"
        if lock.is_file():
            reason = (
                f"{lock} has no entry for it: it was written by hand or by a sweep, not by `dvc "
                "repro`"
            )
        inspection.add("provenance", ("unknown", reason))
    if entry is None or not is_artifact:
        return
    for out in entry.outs:
        if out.path == relative_path.as_posix():
            _warn_if_changed(inspection, path, lock, out)


def _warn_if_changed(inspection: Inspection, path: Path, lock: Path, out: LockedFile) -> None:
    """Warn if an artifact has another size or number of files than the lock recorded as `out`."""
    if out.size is None:
        return
    file_count = sum(1 for file in path.rglob("*") if file.is_file()) if path.is_dir() else 1
    present_bytes = bytes_on_disk(path)
    if (file_count, present_bytes) == (out.file_count, out.size):
        return
    recorded_text = f"{out.file_count} with {out.size:,}"
    remedy = "a lost one reads as zeros: remove the artifact and `dvc checkout` it, or `dvc repro`"
    warning = (
        f"not what {lock} recorded: {file_count} files with {present_bytes:,} bytes, recorded "
        f"{recorded_text}; {remedy}"
    )
    inspection.warnings = (warning, *inspection.warnings)


def _rows(entry: LockEntry) -> list[tuple[str, str]]:
    """Rows on a stage: its name, command, parameters by file, inputs, and code."""
    rows = [("stage", entry.stage), ("cmd", " ".join(entry.command.split()))]
    params = [
        f"{file}: {_settings(values) or 'nothing set'}" for file, values in entry.params.items()
    ]
    code = [dep.path for dep in entry.deps if dep.path.startswith(("pipeline", "stages", "worlds"))]
    inputs = [f"{dep.path} ({_digest(dep)})" for dep in entry.deps if dep.path not in code]
    for title, lines in (("params", params), ("deps", inputs)):
        for number, line in enumerate(lines):
            rows.append(("" if number else title, line))
    if code:
        rows.append(("code", ", ".join(code)))
    return rows


def _settings(values: Mapping[str, Any]) -> str:
    """The settings of a conf file that have a value, as one line."""
    return ", ".join(
        f"{key}={one_line(value)}"
        for key, value in values.items()
        if value is not None and key != "defaults"
    )


def _digest(dep: LockedFile) -> str:
    """Hash, size and number of files of an input."""
    count = f", {dep.file_count} files" if dep.is_folder else ""
    length = "" if dep.size is None else f", {nbytes(dep.size)}"
    return f"{dep.md5[:8]}{length}{count}"


def bytes_on_disk(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def one_line(value: object) -> str:
    """The value of a parameter as one line of text."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(one_line(item) for item in value) + "]"
    if isinstance(value, dict):
        items = ", ".join(f"{key}: {one_line(item)}" for key, item in value.items())
        return "{" + items + "}" if value else "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
