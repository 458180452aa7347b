"""The provenance of a file in dvc.lock: the stage that wrote it, and whether the file is still as that stage wrote it."""

from pathlib import Path
from typing import Any

from pipeline.inspection.inspection import Section, nbytes
from pipeline.running.dvc_files import DvcLock


def origin(path: Path, lock: Path) -> Section:
    """The stage that wrote `path`, or the folder around it: its cmd, parameters and dependencies."""
    known = _recipe(path, lock)[0]
    if known is None:
        by_hand = f"{lock} has no entry for it: it was written by hand or by a sweep, not by `dvc repro`"
        why = by_hand if lock.is_file() else f"there is no {lock}"
        return Section("provenance", (("unknown", why),))
    params = [
        f"{file}: "
        + (", ".join(f"{key}={short(value)}" for key, value in values.items() if _is_set(key, value)) or "nothing set")
        for file, values in (known.get("params") or {}).items()
    ]
    deps = {str(dep.get("path")): dep for dep in known.get("deps") or []}
    code = [name for name in deps if name.startswith(("pipeline", "stages"))]
    data = [f"{name} ({_digest(dep)})" for name, dep in deps.items() if name not in code]
    rows = [("stage", str(known["stage"])), ("cmd", " ".join(str(known.get("cmd", "")).split()))]
    rows += [("params" if i == 0 else "", line) for i, line in enumerate(params)]
    rows += [("deps" if i == 0 else "", line) for i, line in enumerate(data)]
    rows += [("code", ", ".join(code))] if code else []
    return Section("provenance", tuple(rows))


def changed(path: Path, lock: Path) -> tuple[str, ...]:
    """A warning if dvc.lock has another number of files or bytes for `path`: zarr reads a lost shard as zeros."""
    known, name = _recipe(path, lock)
    out: dict[str, Any] = next((out for out in (known or {}).get("outs", []) if out.get("path") == name), {})
    files, there = int(out.get("nfiles", 1)), size(path)
    count = sum(1 for file in path.rglob("*") if file.is_file()) if path.is_dir() else 1
    if "size" not in out or (count, there) == (files, int(out["size"])):
        return ()
    found, recorded = f"{count} files with {there:,} bytes", f"{files} with {int(out['size']):,}"
    remedy = "a lost one reads as zeros: remove the artifact and `dvc checkout` it, or `dvc repro`"
    return (f"not what {lock} recorded: {found}, recorded {recorded}; {remedy}",)


def size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else path.stat().st_size


def short(value: object) -> str:
    """The value of a parameter as one line of text."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(short(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {short(item)}" for key, item in value.items()) + "}" if value else "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _recipe(path: Path, lock: Path) -> tuple[dict[str, Any] | None, str]:
    """The entry of `path`, or of the nearest folder above it, in dvc.lock, and the name of `path` there."""
    try:
        below = path.resolve().relative_to(lock.resolve().parent)
    except ValueError:
        below = path
    return DvcLock.read(lock).entry(below), below.as_posix()


def _is_set(key: str, value: object) -> bool:
    """Whether a key of a conf file holds a value: a null is set on the command line, `defaults` names other files."""
    return value is not None and key != "defaults"


def _digest(dep: dict[str, Any]) -> str:
    """Hash, size and files of a dependency."""
    count = f", {dep['nfiles']} files" if "nfiles" in dep else ""
    length = f", {nbytes(int(dep['size']))}" if "size" in dep else ""
    return f"{str(dep.get('md5', dep.get('hash', '')))[:8]}{length}{count}"
