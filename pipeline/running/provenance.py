"""Where an artifact came from: what dvc.lock recorded, and a key for work that is not yet an artifact."""

import hashlib
import inspect
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml


def fingerprint(*parts: object) -> str:
    """A key of arrays, classes (with the project's modules that they need) and anything whose text says it all."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(b"\0part\0")
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).data)
        elif isinstance(part, type):
            for path in sorted(_sources(part.__module__, set())):
                digest.update(Path(path).read_bytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()[:32]


def recipe(path: Path, lock: Path = Path("dvc.lock")) -> dict[str, Any] | None:
    """What dvc.lock says of the stage that wrote `path`, or a folder around it: its name, cmd, deps, params and outs.

    None if it knows no such file.
    """
    try:
        stages = _stages(lock, lock.stat().st_mtime_ns)
    except (FileNotFoundError, yaml.YAMLError):
        return None
    around = {path.as_posix(), *(parent.as_posix() for parent in path.parents)}
    found = ((name, stage) for name, stage in stages.items() if around & {out["path"] for out in stage.get("outs", [])})
    return next(({"stage": name, **stage} for name, stage in found), None)


@lru_cache(maxsize=4)
def _stages(lock: Path, written_ns: int) -> dict[str, Any]:
    """The stages of a dvc.lock as it was written at that time: a big one takes a third of a second to parse."""
    return (yaml.safe_load(lock.read_text()) or {}).get("stages", {})  # type: ignore[no-any-return]


def _sources(module: str, seen: set[str]) -> set[str]:
    """Files of a module of this project and of those it imports."""
    if module in seen or not module.startswith("pipeline") or module not in sys.modules:
        return set()
    seen.add(module)
    loaded = sys.modules[module]
    files = {inspect.getsourcefile(loaded) or ""}
    for value in vars(loaded).values():
        name = value.__name__ if inspect.ismodule(value) else getattr(value, "__module__", None)
        if isinstance(name, str):
            files |= _sources(name, seen)
    return {file for file in files if file}
