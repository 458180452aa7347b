"""Raw logs → pose-aligned scans of one sequence."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.mapping.scans import Intake
from pipeline.readers.parts import open_part
from stages import ProgressBar, stage


@stage("scans")
def main(cfg: DictConfig) -> str:
    log = open_part(instantiate(cfg.dataset.reader), Path(cfg.root), cfg.sequence)
    intake = Intake(log, cfg.grain_m, cfg.every_m)
    attrs = {"grain_m": cfg.grain_m, "skipped": intake.skipped, "clipped": intake.clipped}
    with instantiate(cfg.compute) as compute, store.draft(cfg.out, schemas.Scans, **attrs) as out:
        for points, offsets in intake.blocks(compute, ProgressBar()):
            out.append("points", points)
            out.append("offsets", offsets)
        for name, column in intake.poses().items():
            out.put(name, column)
    return f"{cfg.sequence}: {'; '.join([intake.summary(), *log.notes])}"


if __name__ == "__main__":
    main()
