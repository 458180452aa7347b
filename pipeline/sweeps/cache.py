"""The cache of sweeps: a key of code, parameters and inputs in; a folder with the artifacts out.

What one job has built no later one builds again.
"""

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
        """The folder of an entry with the files `names`, and whether it was built just now.

        `build` is to write the files into the folder; it is called where one is missing.
        """
        folder = self.root / kind / key
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):
            is_unfinished = not all((folder / name).exists() for name in names)
            if is_unfinished:
                build(folder)
        return folder, is_unfinished

    def gather(self, parts: Mapping[str, str]) -> Path:
        """A folder of symbolic links: name in it to the path that it leads to."""
        folder = self.root / "gathered" / fingerprint(sorted(parts.items()))
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in parts.items():
            with suppress(FileExistsError):
                (folder / name).symlink_to(Path(path).absolute())
        return folder
