"""Fingerprints of a computation's inputs, by which its unfinished work is found again."""

import hashlib
import inspect
import sys
from pathlib import Path

import numpy as np


def fingerprint(*parts: object) -> str:
    """A digest of the parts: of an array's numbers, a class's sources, anything else's repr.

    A class's sources are its module and the modules of this project that it imports.
    """
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


def _sources(module: str, seen: set[str]) -> set[str]:
    """The source files of a module of this project and of those it imports, but those in `seen`."""
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
