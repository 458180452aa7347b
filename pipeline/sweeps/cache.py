"""The cache of sweeps: what one job of a sweep has built, no later job builds again.

An entry is found by its kind and a key, a digest of all that its artifacts depend on: the code, the
parameters and the keys of the inputs (`resolver`).
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

from pipeline.running.provenance import fingerprint


@dataclass(frozen=True)
class ArtifactCache:
    """A folder with an entry for each kind and key, such as `train/0f3c…/sci.zarr.zip`.

    Every file of an entry is written whole or not at all, so an entry is finished when all its
    files exist. A lock beside it makes a second job wait for the one that builds it. Entries may be
    deleted at any time; they are then built again.
    """

    root: Path
    """The cache's folder."""

    def get(
        self, kind: str, key: str, names: Sequence[str], build: Callable[[Path], None]
    ) -> tuple[Path, bool]:
        """The folder of an entry with the files `names`, and whether it was built just now.

        If a file is missing, `build(folder)` is called, which must write all of them.
        """
        folder = self.root / kind / key
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):
            is_unfinished = not all((folder / name).exists() for name in names)
            if is_unfinished:
                build(folder)
        return folder, is_unfinished

    def gather(self, targets: Mapping[str, str]) -> Path:
        """Make a folder of symbolic links; `targets` has the path that each name in it leads to."""
        folder = self.root / "gathered" / fingerprint(sorted(targets.items()))
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in targets.items():
            with suppress(FileExistsError):  # another job may make the same folder
                (folder / name).symlink_to(Path(path).absolute())
        return folder
