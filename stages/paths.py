"""Stage `paths`: joins the poses of single queries along the path of each test sequence.

It reads the fixes that the stage `poses` found for each query by itself, and the odometry between
them. It writes fixes that agree with both, in the same form.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import schemas, store
from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.level.sweeps import OVER_M
from pipeline.mapping.gathering import gathered_m
from pipeline.matching.places import Places
from pipeline.paths.belief import NEW_VIEW_M
from pipeline.paths.tracks import joined
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/paths.yaml."""

    path: Any
    """Joins fixes and odometry: a file of conf/path."""
    train: str
    fixes: Path
    """Folder of one model's fixes."""
    labels: Path
    scans: Path
    submaps: Path


@stage("paths")
def main(settings: Settings) -> str:
    def follow(sequence: str, folder: Path) -> str:
        """Write the joined fixes of one sequence; it may run in a process of its own."""
        name = f"{sequence}.zarr"
        train = f"{settings.train}.zarr"
        fixes = store.read(settings.fixes / name, schemas.Fixes)
        submaps = store.read(settings.submaps / name, schemas.Submaps)
        scans = store.read(settings.scans / name, schemas.Scans)
        places = Places.of(store.read(settings.labels / train, schemas.Labels))
        new_view_m = view_reach_m(fixes, scans, submaps)
        odom_T_anchor = scans.odom_T_scan[submaps.scans]
        along_path = joined(fixes, odom_T_anchor, settings.path, places, new_view_m)
        store.write(folder / name, along_path)
        n_accepted = int((along_path.novelty[:, 0] < along_path.reject_from()).sum())
        n_accepted_alone = int((fixes.novelty[:, 0] < fixes.reject_from()).sum())
        return (
            f"{sequence}: {n_accepted} of {len(along_path.novelty)} queries accepted along the "
            f"path, {n_accepted_alone} one by one"
        )

    return each_sequence(settings, follow, "paths")


def view_reach_m(fixes: schemas.Fixes, scans: schemas.Scans, submaps: schemas.Submaps) -> float:
    """How far a robot must move until its next query is a view of its own: queries that gather
    the same scans are not."""
    if tuple(fixes.right_within) == LEVEL_RIGHT_WITHIN:
        return OVER_M  # the stage `poses` gathers level sweeps over this path, not by submaps
    return max(NEW_VIEW_M, gathered_m(scans, submaps))


if __name__ == "__main__":
    main()
