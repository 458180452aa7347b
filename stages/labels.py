"""Submaps → places: the grid cells of the training sequence, and which of them each submap of a sequence is in."""

from dataclasses import asdict

from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.frames import days_between
from pipeline.grid import Grid, around
from pipeline.matching.places import label
from stages import stage


@stage("labels")
def main(cfg: DictConfig) -> str:
    submaps, training = store.read(cfg.submaps, schemas.SUBMAPS), store.read(cfg.training, schemas.SUBMAPS)
    world_T_training, box = training.load("world_T_anchor"), cfg.dataset.box
    grid = Grid(cfg.grid.cell_m, tuple(box.x_m), tuple(box.y_m)) if box else around(world_T_training[:, :2, 3], cfg.grid.cell_m)
    labels = label(submaps.load("world_T_anchor"), world_T_training, grid)
    days = days_between(training["stamps_ns"][0], submaps["stamps_ns"][0])
    with store.write(cfg.out, schemas.LABELS, days=days, cell_m=grid.cell_m, x_m=list(grid.x_m), y_m=list(grid.y_m)) as out:
        for name, column in asdict(labels).items():
            out.put(name, column)
    seen = int((labels.places >= 0).sum())
    told = "" if seen else "; no submap lies at a place of training: do the poses of both share a frame?"
    return (
        f"{cfg.sequence}: {seen} seen, {len(labels.places) - seen} unseen, {len(labels.cells)} places of {grid.cell_m:g} m{told}"
    )


if __name__ == "__main__":
    main()
