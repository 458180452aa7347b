"""Submaps → one view of each, as a method looks at it."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.views.draw import BLOCK, Drawing
from stages import Bars, stage

SEEN = 0.01
"""A view that nowhere reaches this, in metres or its own unit, shows nothing."""


@stage("views")
def main(cfg: DictConfig) -> str:
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        told = [draw(cfg, sequence, folder) for sequence in cfg.sequences.split()]
    return "; ".join(told)


def draw(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """The views of one sequence."""
    submaps = store.read(Path(cfg.submaps, f"{sequence}.zarr"), schemas.SUBMAPS)
    view, blank, sides = instantiate(cfg.view), 0, list[int]()
    drawing = Drawing(store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.SCANS), submaps, view)
    with store.write(folder / f"{sequence}.zarr", view.schema) as out:
        for images in Bars().track(drawing.blocks(instantiate(cfg.compute)), -(-len(drawing) // BLOCK), f"draw {sequence}"):
            out.append("images", images)
            blank += int((images < SEEN).all(axis=tuple(range(1, images.ndim))).sum())
            sides = list(images.shape[1:])
        if blank == len(drawing):
            raise ArtifactError(f"{submaps.path}: all views are blank, nothing stands off the ground; lift_m, or submap: flat?")
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    shape = " × ".join(f"{side} {dim}s" for side, dim in zip(sides, view.schema.columns["images"].dims[1:], strict=True))
    return f"{sequence}: {len(drawing)} views of {shape}" + (f", {blank} of them blank" if blank else "")


if __name__ == "__main__":
    main()
