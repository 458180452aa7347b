"""The scans of logs without poses → their poses, in a world of the training sequence's."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate

from pipeline.core import store
from pipeline.readers.estimated import poses_of
from pipeline.readers.log import Log
from pipeline.readers.parts import open_part
from pipeline.slam.drive import Estimate, Slam, without_truth
from pipeline.slam.kept import artifact
from pipeline.slam.onto import estimate_onto
from pipeline.slam.outputs import draw
from stages import EachSequence, ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """What the stage takes of a file of conf/dataset."""

    reader: Any


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """What the stage is told."""

    dataset: DataSet
    root: Path
    """Folder of the logs."""
    train: str
    slam: Slam


@stage("slam")
def main(settings: Settings) -> str:
    slam = settings.slam

    def opened(sequence: str) -> Log:
        return without_truth(open_part(settings.dataset.reader, settings.root, sequence))

    def write(folder: Path, sequence: str, estimate: Estimate) -> str:
        store.write(folder / f"{sequence}.zarr", artifact(estimate))
        draw(estimate, folder / f"{sequence}.png", sequence)
        return f"{sequence}: {'; '.join(estimate.lines())}"

    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        folder.mkdir()
        map_log = opened(settings.train)
        lines = [write(folder, settings.train, slam.estimate(map_log, ProgressBar()))]
        map_poses = poses_of(folder / f"{settings.train}.zarr", map_log)

        def further(sequence: str) -> str:
            """Lay one further day onto the map."""
            log = opened(sequence)
            estimate = estimate_onto(slam, log, map_log, map_poses, ProgressBar())
            return write(folder, sequence, estimate)

        others = [name for name in settings.sequences if name != settings.train]
        lines += compute.each(further, others)
    return "; ".join(lines)


if __name__ == "__main__":
    main()
