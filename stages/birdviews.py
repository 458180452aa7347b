"""Scans, in order → bird-views of the dynamic octree that they grow, one of each submap at each heading."""

from dataclasses import asdict
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.alterations import Case
from pipeline.errors import ArtifactError
from pipeline.views.mapped import MappedViews
from stages import ProgressBar, stage

AS_DRIVEN = [asdict(Case())]
"""The one case of views as they were driven."""


@stage("birdviews")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        done = instantiate(cfg.compute).each(lambda sequence: draw(cfg, sequence, folder), sequences)
        lines = list(ProgressBar().track(done, len(sequences), "draw"))
    return "; ".join(lines)


def draw(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """The bird-views of one sequence."""
    scans, submaps = (
        store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.SCANS),
        store.read(Path(cfg.submaps, f"{sequence}.zarr"), schemas.SUBMAPS),
    )
    mapped, blank = MappedViews(scans, submaps, instantiate(cfg.view)), 0
    with store.write(folder / f"{sequence}.zarr", schemas.BIRDVIEWS, cases=AS_DRIVEN) as out:
        for images in mapped:
            out.append("images", images[None])
            blank += not images[0].any()
        if blank == len(mapped):
            raise ArtifactError(f"{submaps.path}: all bird-views are blank; is the ground at 0, and anything within the z band?")
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    shape = " × ".join(map(str, images.shape))
    return f"{sequence}: {len(mapped)} views of {shape} (heading, row, col)" + (f", {blank} of them blank" if blank else "")


if __name__ == "__main__":
    main()
