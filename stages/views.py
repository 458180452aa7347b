"""Submaps → one view of each, as a method looks at it."""

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.views.draw import BLOCK, Drawing
from stages import Bars, stage


@stage("views")
def main(cfg: DictConfig) -> str:
    scans, submaps = store.read(cfg.scans, schemas.SCANS), store.read(cfg.submaps, schemas.SUBMAPS)
    drawing = Drawing(scans, submaps, instantiate(cfg.view))
    with store.write(cfg.out, schemas.VIEWS) as out:
        for images in Bars().track(drawing.blocks(instantiate(cfg.compute)), -(-len(drawing) // BLOCK), "draw"):
            out.append("images", images)
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    return f"{cfg.sequence}: {len(drawing)} images of {cfg.view.rings} rings × {cfg.view.sectors} sectors"


if __name__ == "__main__":
    main()
