"""Submaps of some test sequences → views of them in every case of an alteration: turned, with walls
added or parts missing."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.views.altered import altered
from stages import ProgressBar, stage


@stage("altered")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        lines = compute.each(lambda sequence: draw(cfg, sequence, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), "alter"))


def draw(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """Draw the views of one sequence in every case but the one as driven.

    The stage of the view draws that one.
    """
    scans = Path(cfg.scans, f"{sequence}.zarr")
    submaps = Path(cfg.submaps, f"{sequence}.zarr")
    view = instantiate(cfg.view)
    alteration = instantiate(cfg.alteration)
    cases = altered(
        store.read(scans, schemas.Scans), store.read(submaps, schemas.Submaps), view, alteration
    )
    listed = [asdict(case) for case in cases]
    with store.draft(folder / f"{sequence}.zarr", view.schema, cases=listed) as out:
        for rows in cases.values():
            out.append("images", rows.images)
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, np.concatenate([getattr(rows, name) for rows in cases.values()]))
    return f"{sequence}: {len(cases)} cases of {len(next(iter(cases.values())).stamps_ns)} views"


if __name__ == "__main__":
    main()
