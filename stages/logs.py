"""A world → raw logs of one sequence, in a data set's own format; or recorded logs → an inventory
of them."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import store
from stages import ProgressBar, stage


@stage("logs")
def main(cfg: DictConfig) -> str:
    recorded = {} if cfg.dataset.simulated else {"reader": cfg.dataset.reader, "root": cfg.root}
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        line = instantiate(cfg.world, **recorded).record(
            cfg.sequence, Path(folder), compute, ProgressBar()
        )
    return f"{cfg.sequence}: {line}"


if __name__ == "__main__":
    main()
