"""Submaps → one view of each."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from pipeline.views.draw import Drawing
from stages import ProgressBar, stage


@stage("views")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        if opened(cfg, sequences[0]).one_scan_each:
            lines = [draw(cfg, sequence, folder, compute, ProgressBar()) for sequence in sequences]
        else:  # neighbouring submaps share scans: sequences are drawn side by side, not blocks
            drawings = compute.each(
                lambda sequence: draw(cfg, sequence, folder, Compute(workers=1), Progress()),
                sequences,
            )
            lines = list(ProgressBar().track(drawings, len(sequences), "draw"))
    return "; ".join(lines)


def opened(cfg: DictConfig, sequence: str) -> Drawing:
    """One sequence's scans and submaps, and the view to compute."""
    scans = Path(cfg.scans, f"{sequence}.zarr")
    submaps = Path(cfg.submaps, f"{sequence}.zarr")
    return Drawing(
        store.read(scans, schemas.Scans),
        store.read(submaps, schemas.Submaps),
        instantiate(cfg.view),
    )


def draw(cfg: DictConfig, sequence: str, folder: Path, compute: Compute, progress: Progress) -> str:
    """The views of one sequence."""
    return (
        f"{sequence}: {opened(cfg, sequence).write(folder / f'{sequence}.zarr', compute, progress)}"
    )


if __name__ == "__main__":
    main()
