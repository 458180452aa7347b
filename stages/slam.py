"""Stage `slam`: estimates the poses of a log without poses, from its scans.

The training sequence is estimated first; its poses define the world's frame. All other sequences
are then located on the training sequence's map, so that all poses are in the same world.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import store
from pipeline.readers.estimated import estimates_of
from pipeline.readers.log import Log
from pipeline.readers.splits import open_split
from pipeline.slam.drive import Slam, without_ground_truth
from pipeline.slam.onto import estimate_onto
from pipeline.slam.outputs import draw
from pipeline.slam.summary import lines
from stages import ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """The settings of a file of conf/dataset that this stage uses."""

    reader: Any


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/slam.yaml."""

    dataset: DataSet
    root: Path
    """Folder of the logs."""
    sequence: str
    train: str
    """The training sequence, whose estimated poses define the world's frame."""
    slam: Slam
    """Estimates the poses."""
    picture: Path
    """File for a picture of the trajectory (PNG)."""
    out: Path
    map: Path | None = None
    """The training sequence's estimated poses; None for the training sequence itself."""


@stage("slam")
def main(settings: Settings) -> str:
    def open_log(sequence: str) -> Log:
        """Open the raw log of a sequence, without the true poses that it may have."""
        return without_ground_truth(open_split(settings.dataset.reader, settings.root, sequence))

    log = open_log(settings.sequence)
    if settings.map is None:
        estimate = settings.slam.estimate(log, ProgressBar())
    else:
        map_log = open_log(settings.train)
        map_poses = estimates_of(map_log, settings.map).world_T_scan
        estimate = estimate_onto(settings.slam, log, map_log, map_poses, ProgressBar())
    store.write(settings.out, estimate)
    with store.replace(settings.picture) as scratch:
        draw(estimate, scratch, settings.sequence)
    return f"{settings.sequence}: {'; '.join(lines(estimate))}"


if __name__ == "__main__":
    main()
