"""Artifacts of sweeps, each under a key of all that made it: built once, by whoever comes first, and kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock


@dataclass(frozen=True)
class Shelf:
    """A folder with one entry a key, such as `train/0f3c…/sci.safetensors`.

    Every file of an entry is written whole or not at all, so an entry is finished when all of them are there; a lock
    beside it keeps a second builder waiting. Deleting any of it, or all, costs only the time to build it again.
    """

    root: Path

    def get(self, kind: str, key: str, names: Sequence[str], build: Callable[[Path], None]) -> tuple[Path, bool]:
        """The entry's folder, with the files `names` in it, and whether `build` had to fill it."""
        folder = self.root / kind / key
        if self._finished(folder, names):
            return folder, False
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):
            if self._finished(folder, names):
                return folder, False
            build(folder)
        return folder, True

    def _finished(self, folder: Path, names: Sequence[str]) -> bool:
        return all((folder / name).exists() for name in names)
