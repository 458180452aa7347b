"""Stores what sweeps build under a digest of code, parameters and inputs: each is built once."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

from pipeline.running.provenance import fingerprint


@dataclass(frozen=True)
class ArtifactCache:
    """A folder with one entry a key, such as `train/0f3c…/sci.zarr.zip`.

    Every file of an entry is written whole or not at all, so an entry is finished when all of them
    are there; a lock beside it keeps a second builder waiting. Deleting any of it, or all, costs
    only the time to build it again.
    """

    root: Path

    def get(
        self, kind: str, key: str, names: Sequence[str], build: Callable[[Path], None]
    ) -> tuple[Path, bool]:
        """The folder of an entry with the files `names`, and whether `build` had to write them."""
        folder = self.root / kind / key
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):
            unfinished = not all((folder / name).exists() for name in names)
            if unfinished:
                build(folder)
        return folder, unfinished

    def gather(self, parts: Mapping[str, str]) -> Path:
        """Make a folder of symbolic links, from names to paths."""
        folder = self.root / "gathered" / fingerprint(sorted(parts.items()))
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in parts.items():
            with suppress(FileExistsError):
                (folder / name).symlink_to(Path(path).absolute())
        return folder
