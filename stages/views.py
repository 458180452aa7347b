"""Submaps → one view of each."""

from dataclasses import asdict
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.alterations import Case
from pipeline.errors import ArtifactError
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from pipeline.views.draw import BLOCK, Drawing
from stages import ProgressBar, stage

SEEN = 0.01
"""A view that nowhere reaches this, in metres or its own unit, shows nothing."""


AS_DRIVEN = [asdict(Case())]
"""The one case of views as they were driven."""


@stage("views")
def main(cfg: DictConfig) -> str:
    sequences, compute = cfg.sequences.split(), instantiate(cfg.compute)
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        if opened(cfg, sequences[0]).one_scan_each:
            lines = [draw(cfg, sequence, folder, compute, ProgressBar()) for sequence in sequences]
        else:  # neighbouring submaps share scans: sequences are drawn side by side, not blocks
            done = compute.each(lambda sequence: draw(cfg, sequence, folder, Compute(workers=1), Progress()), sequences)
            lines = list(ProgressBar().track(done, len(sequences), "draw"))
    return "; ".join(lines)


def opened(cfg: DictConfig, sequence: str) -> Drawing:
    """One sequence's scans and submaps, and the view to compute."""
    scans, submaps = Path(cfg.scans, f"{sequence}.zarr"), Path(cfg.submaps, f"{sequence}.zarr")
    return Drawing(store.read(scans, schemas.SCANS), store.read(submaps, schemas.SUBMAPS), instantiate(cfg.view))


def draw(cfg: DictConfig, sequence: str, folder: Path, compute: Compute, progress: Progress) -> str:
    """The views of one sequence."""
    drawing, blank, sides = opened(cfg, sequence), 0, list[int]()
    submaps, schema = drawing.submaps, drawing.view.schema
    with store.write(folder / f"{sequence}.zarr", schema, cases=AS_DRIVEN) as out:
        for images in progress.track(drawing.blocks(compute), -(-len(drawing) // BLOCK), f"draw {sequence}"):
            out.append("images", images)
            blank += int((images < SEEN).all(axis=tuple(range(1, images.ndim))).sum())
            sides = list(images.shape[1:])
        if blank == len(drawing):
            raise ArtifactError(f"{submaps.path}: all views are blank, nothing stands off the ground; lift_m, or submap: flat?")
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    shape = " × ".join(map(str, sides)), ", ".join(schema.columns["images"].dims[1:])
    return f"{sequence}: {len(drawing)} views of {shape[0]} ({shape[1]})" + (f", {blank} of them blank" if blank else "")


if __name__ == "__main__":
    main()
