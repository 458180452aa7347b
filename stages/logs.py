"""Stage `logs`: drives one sequence through a simulated world, and writes its raw logs.

The logs have the data set's own format, so that the later stages read simulated and recorded logs
in the same way. For recorded logs, the stage checks that the files are there and writes a list of
them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline.core import store
from stages import ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """The settings of a file of conf/dataset that this stage uses."""

    simulated: bool
    reader: DictConfig


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/logs.yaml."""

    dataset: DataSet
    world: DictConfig
    sequence: str
    compute: DictConfig
    out: Path
    root: str | None = None
    """Folder of the recorded logs; None for a simulated world."""


@stage("logs")
def main(settings: Settings) -> str:
    world = world_of(settings.world, settings.dataset, settings.root)
    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        line = world.record(settings.sequence, Path(folder), compute, ProgressBar())
    return f"{settings.sequence}: {line}"


def world_of(world: DictConfig, dataset: DataSet, root: str | None) -> Any:
    """The simulated world, or the recorded world whose logs lie below `root`."""
    if dataset.simulated:
        return instantiate(world)
    return instantiate(world, reader=dataset.reader, root=root)


if __name__ == "__main__":
    main()
