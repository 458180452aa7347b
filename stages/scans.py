"""Stage `scans`: reads the raw logs of one sequence, and writes its scans, each with its pose.

Each data set has its own reader. This stage writes all logs in one form, so that the later stages
read only scans (or 2-D sweeps), poses in the world, and odometry.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline.core import schemas, store
from pipeline.core.settings import NotNegative, Positive
from pipeline.mapping.scans import Intake
from pipeline.readers.estimated import with_estimated_poses
from pipeline.readers.splits import open_split
from stages import ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """The settings of a file of conf/dataset that this stage uses."""

    reader: Any
    """The reader of the logs: an object of a class of pipeline.readers."""


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/scans.yaml."""

    dataset: DataSet
    root: Path
    """Folder of the logs."""
    sequence: str
    slam: Path
    """Folder of the poses that the stage `slam` estimated; empty if the logs have poses."""
    grain_m: Positive
    """Length of one unit of the stored points, which are whole numbers."""
    every_m: NotNegative
    """Path after which the next scan is stored; 0 stores all scans."""
    compute: DictConfig
    """The workers that read blocks of scans: a file of conf/compute."""
    out: Path


@stage("scans")
def main(settings: Settings) -> str:
    log = open_split(settings.dataset.reader, settings.root, settings.sequence)
    has_estimated_poses = any(settings.slam.iterdir())
    if has_estimated_poses:
        log = with_estimated_poses(log, settings.slam)
    intake = Intake(log, settings.grain_m, settings.every_m)
    # `skipped` and `clipped` are methods; the draft calls them once all blocks are written
    attrs = {
        "grain_m": settings.grain_m,
        "skipped": intake.skipped,
        "clipped": intake.clipped,
    }
    with (
        instantiate(settings.compute) as compute,
        store.draft(settings.out, schemas.Scans, **attrs) as out,
    ):
        for points, offsets in intake.blocks(compute, ProgressBar()):
            out.append("points", points)
            out.append("offsets", offsets)  # where each scan begins in `points`
        for name, column in intake.poses().items():
            out.put(name, column)
    return f"{settings.sequence}: {'; '.join([intake.summary(), *log.notes])}"


if __name__ == "__main__":
    main()
