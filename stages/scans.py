"""Raw logs → pose-aligned scans of one sequence."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline.core import schemas, store
from pipeline.core.settings import NotNegative, Positive
from pipeline.mapping.scans import Intake
from pipeline.readers.estimated import with_estimated_poses
from pipeline.readers.parts import open_part
from stages import ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """What the stage takes of a file of conf/dataset."""

    reader: Any


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/scans.yaml."""

    dataset: DataSet
    root: Path
    """Folder of the logs."""
    sequence: str
    slam: Path
    """Its estimated poses; an empty folder where the logs have their own."""
    grain_m: Positive
    every_m: NotNegative
    compute: DictConfig
    out: Path


@stage("scans")
def main(settings: Settings) -> str:
    log = open_part(settings.dataset.reader, settings.root, settings.sequence)
    log = with_estimated_poses(log, settings.slam) if any(settings.slam.iterdir()) else log
    intake = Intake(log, settings.grain_m, settings.every_m)
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
            out.append("offsets", offsets)
        for name, column in intake.poses().items():
            out.put(name, column)
    return f"{settings.sequence}: {'; '.join([intake.summary(), *log.notes])}"


if __name__ == "__main__":
    main()
