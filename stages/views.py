"""Submaps → one view of each, as a method looks at it."""

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.views.draw import BLOCK, Drawing
from stages import Bars, stage

SEEN_M = 0.01
"""An image that nowhere reaches this height shows nothing."""


@stage("views")
def main(cfg: DictConfig) -> str:
    scans, submaps = store.read(cfg.scans, schemas.SCANS), store.read(cfg.submaps, schemas.SUBMAPS)
    drawing, blank = Drawing(scans, submaps, instantiate(cfg.view)), 0
    with store.write(cfg.out, schemas.VIEWS) as out:
        for images in Bars().track(drawing.blocks(instantiate(cfg.compute)), -(-len(drawing) // BLOCK), "draw"):
            out.append("images", images)
            blank += int((images < SEEN_M).all(axis=(1, 2)).sum())
        if blank == len(drawing):
            raise ArtifactError(f"{cfg.submaps}: all images are blank, nothing stands off the ground; lift_m, or submap: flat?")
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    told = f", {blank} of them blank" if blank else ""
    return f"{cfg.sequence}: {len(drawing)} images of {cfg.view.rings} rings × {cfg.view.sectors} sectors{told}"


if __name__ == "__main__":
    main()
