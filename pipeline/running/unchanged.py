"""Whether `dvc repro` would find anything to do: by the stat of every file that it looks at, in a fraction of its time."""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

SOURCES = ("conf", "dag", "dvc.yaml", "pipeline", "stages", ".dvc/config", ".dvc/config.local", ".dvcignore")
RESULTS = ("artifacts", ".dvc/locks")
STATE = Path(".dvc/tmp/unchanged.json")
SKIPPED = ("__pycache__", ".numba")
LOCK = "dvc.lock"
"""A link into .dvc/locks, beside each dvc.yaml."""


def unchanged(root: Path) -> bool:
    """Whether all files are as `remember` found them; if not, notes the sources that the next `dvc repro` starts from."""
    sources, state = _stats(root, SOURCES), _state(root)
    if state.get("sources") == sources and state.get("results") == _stats(root, RESULTS):
        return True
    _write(root, {"sources": sources})
    return False


def remember(root: Path) -> bool:
    """After a `dvc repro` that ended well: note all files. False, and nothing noted, if a source changed meanwhile."""
    sources = _stats(root, SOURCES)
    if _state(root).get("sources") != sources:
        return False
    _write(root, {"sources": sources, "results": _stats(root, RESULTS)})
    return True


def _stats(root: Path, names: Sequence[str]) -> str:
    """A digest of path, size, times and inode of every file."""
    digest = hashlib.sha256()
    for path in sorted(path for name in names for path in _files(root.absolute() / name)):
        found = os.stat(path) if os.path.exists(path) else os.lstat(path)  # of a link to nothing its own
        digest.update(f"{path}\0{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}\0".encode())
    return digest.hexdigest()


def _files(path: Path) -> Iterator[str]:
    if path.is_file():
        yield str(path)
    for folder, folders, files in os.walk(path, followlinks=True):
        folders[:] = [name for name in folders if name not in SKIPPED]
        yield from (os.path.join(folder, name) for name in files if name != LOCK)


def _state(root: Path) -> dict[str, str]:
    try:
        return dict(json.loads((root / STATE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def _write(root: Path, state: dict[str, str]) -> None:
    (root / STATE).parent.mkdir(parents=True, exist_ok=True)
    (root / STATE).write_text(json.dumps(state), encoding="utf-8")  # half of it, after a kill, is no state
