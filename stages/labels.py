"""Submaps → places: the grid cells of the training sequence, and which of them each submap of a
sequence is in."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.frames import days_between
from pipeline.grid import Grid, around
from pipeline.matching.places import label
from stages import stage


@stage("labels")
def main(cfg: DictConfig) -> str:
    trained = cfg.train.split()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        lines = [
            labelled(cfg, sequence, sequence if sequence in trained else trained[0], folder)
            for sequence in cfg.sequences.split()
        ]
    return "; ".join(lines)


def labelled(cfg: DictConfig, sequence: str, train: str, folder: Path) -> str:
    """The labels of one sequence by a training one.

    Of several training sequences each is labelled by itself.
    """
    submaps, training = (
        store.read(Path(cfg.submaps, f"{name}.zarr"), schemas.Submaps) for name in (sequence, train)
    )
    xy_m = training.world_T_anchor[:, :2, 3]
    area = cfg.dataset.box
    grid = (
        Grid(cfg.grid.cell_m, tuple(area.x_m), tuple(area.y_m))
        if area
        else around(xy_m, cfg.grid.cell_m)
    )
    days = days_between(training.stamps_ns[0], submaps.stamps_ns[0])
    labels = label(submaps.world_T_anchor, training.world_T_anchor, grid, days)
    store.write(folder / f"{sequence}.zarr", labels)
    seen = int((labels.places >= 0).sum())
    hint = (
        ""
        if seen
        else ": no submap lies at a place of training, do the poses of both share a frame?"
    )
    return (
        f"{sequence}: {seen} seen, {len(labels.places) - seen} unseen, {len(labels.cells)} places "
        f"of {grid.cell_m:g} m{hint}"
    )


if __name__ == "__main__":
    main()
