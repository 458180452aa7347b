"""Stage `submaps`: chooses the scans of each sequence that make a submap.

A submap consists of the points of one scan, or of several scans or sweeps, around one anchor pose;
there is one submap every `step_m` of path. The stage writes which scans each submap gathers and
the pose of its anchor, but no points.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.progress import Progress
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/submaps.yaml."""

    submap: Any
    """Cuts a drive into submaps: a file of conf/submap."""
    scans: Path


@stage("submaps")
def main(settings: Settings) -> str:
    def cut(sequence: str, folder: Path) -> str:
        """Write the submaps of one sequence."""
        name = f"{sequence}.zarr"
        scans = store.read(settings.scans / name, schemas.Scans)
        submaps = settings.submap.cut(scans, Progress())
        left_out = "".join(
            f", {count} left out ({reason})" for reason, count in sorted(submaps.left_out.items())
        )
        if not len(submaps.scans):
            raise ArtifactError(
                f"{scans.path}: no submap of submap.step_m={settings.submap.step_m} can be cut "
                f"from it{left_out}"
            )
        store.write(folder / name, submaps)
        return f"{sequence}: {len(submaps.scans)} submaps of {len(submaps.used)} scans{left_out}"

    return each_sequence(settings, cut, "cut")


if __name__ == "__main__":
    main()
