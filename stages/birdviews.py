"""Scans, in order → bird-views of the dynamic octree that they grow, one of each submap at each
heading."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.views.mapped import MappedViews
from stages import ProgressBar, stage


@stage("birdviews")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        drawings = compute.each(lambda sequence: draw(cfg, sequence, folder), sequences)
        lines = list(ProgressBar().track(drawings, len(sequences), "draw"))
    return "; ".join(lines)


def draw(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """The bird-views of one sequence."""
    scans = store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.Scans)
    submaps = store.read(Path(cfg.submaps, f"{sequence}.zarr"), schemas.Submaps)
    return (
        f"{sequence}: "
        f"{MappedViews(scans, submaps, instantiate(cfg.view)).write(folder / f'{sequence}.zarr')}"
    )


if __name__ == "__main__":
    main()
