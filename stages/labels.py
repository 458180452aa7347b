"""Stage `labels`: finds the true place of each submap.

Places are the cells of a grid that the training sequence drove through. The stage reads the submaps
of all sequences. For each submap it writes its place, or that training never went there, and the
distance to the nearest training submap.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pipeline.core import schemas, store
from pipeline.core.frames import days_between
from pipeline.core.grid import Grid, around
from pipeline.core.settings import Names, Range
from pipeline.matching.places import label
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True)
class Box:
    """The rectangle of the world's xy plane that contains a data set's places: lowest, highest."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]


@dataclass(frozen=True)
class DataSet:
    """The settings of a file of conf/dataset that this stage uses."""

    box: Box | None = None


@dataclass(frozen=True)
class Cells:
    """The side of a grid cell: a file of conf/grid."""

    cell_m: Annotated[float, Range(0.1, 10_000)]


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/labels.yaml."""

    dataset: DataSet
    grid: Cells
    train: Names
    submaps: Path


@stage("labels")
def main(settings: Settings) -> str:
    def write_labels(sequence: str, folder: Path) -> str:
        """Write the labels of one sequence, by the places of the first training sequence.

        A training sequence is labelled by its own places instead.
        """
        train = sequence if sequence in settings.train else settings.train[0]
        submaps, training = (
            store.read(settings.submaps / f"{name}.zarr", schemas.Submaps)
            for name in (sequence, train)
        )
        grid = grid_of(settings, training)
        days = days_between(first_ns(settings, training), submaps.stamps_ns[0])
        labels = label(submaps.world_T_anchor, training.world_T_anchor, grid, days)
        store.write(folder / f"{sequence}.zarr", labels)
        n_seen = int((labels.places >= 0).sum())
        hint = ""
        if not n_seen:
            hint = ": no submap lies at a place of training, do the poses of both share a frame?"
        return (
            f"{sequence}: {n_seen} seen, {len(labels.places) - n_seen} unseen, "
            f"{len(labels.cells)} places of {grid.cell_m:g} m{hint}"
        )

    return each_sequence(settings, write_labels, "label")


def first_ns(settings: Settings, training: schemas.Submaps) -> int:
    """The stamp from which days are counted: of training, or of the earliest drive if training has
    no date, as a 3-D map has none."""
    if days_between(0, training.stamps_ns[0]):  # else it is stamped from 0 on
        return int(training.stamps_ns[0])
    others = [name for name in settings.sequences if name not in settings.train]
    submaps = (store.read(settings.submaps / f"{name}.zarr", schemas.Submaps) for name in others)
    return min((int(one.stamps_ns[0]) for one in submaps), default=0)


def grid_of(settings: Settings, training: schemas.Submaps) -> Grid:
    """The data set's own grid, or one around the training sequence's submaps."""
    cell_m = settings.grid.cell_m
    if box := settings.dataset.box:
        return Grid(cell_m, box.x_m, box.y_m)
    return around(training.world_T_anchor[:, :2, 3], cell_m)


if __name__ == "__main__":
    main()
