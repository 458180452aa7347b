"""Stage `map`: thins the points of the training day's submaps to one point a voxel.

The stage `poses` registers queries with these points.
"""

from dataclasses import dataclass
from pathlib import Path

from pipeline.core import schemas, store
from pipeline.core.settings import Positive
from pipeline.posing.targets import write_map
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/map.yaml."""

    scans: Path
    submaps: Path
    voxel_m: Positive
    """Side of a voxel."""
    range_m: Positive
    """Points farther from a submap's anchor are left out."""
    gathered_m: Positive
    """The same as `range_m`, for submaps gathered from several scans.

    It is shorter, since far points suffer most from the drift between these scans.
    """


@stage("map")
def main(settings: Settings) -> str:
    def thin(sequence: str, folder: Path) -> str:
        """Thin the submaps of one training sequence and write them as a map."""
        name = f"{sequence}.zarr"
        n_submaps, n_points = write_map(
            folder / name,
            store.read(settings.scans / name, schemas.Scans),
            store.read(settings.submaps / name, schemas.Submaps),
            voxel_m=settings.voxel_m,
            range_m=settings.range_m,
            gathered_m=settings.gathered_m,
        )
        return (
            f"{sequence}: {n_submaps} submaps, {n_points / 1e6:.1f} M points in voxels of "
            f"{settings.voxel_m} m"
        )

    return each_sequence(settings, thin, "thin")


if __name__ == "__main__":
    main()
