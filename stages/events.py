"""A world → what has changed since training by the day of each sequence: a simulated one's own
events, else the user's csv."""

from collections import Counter
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import store
from pipeline.formats.changes import write_changes
from stages import stage


@stage("events")
def main(cfg: DictConfig) -> str:
    recorded = {} if cfg.dataset.simulated else {"reader": cfg.dataset.reader, "root": cfg.root}
    world = instantiate(cfg.world, **recorded)
    lines = []
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        for sequence in cfg.sequences.split():
            changes = world.changes(cfg.train, sequence)
            write_changes(Path(folder, f"{sequence}.csv"), changes)
            counts = sorted(Counter(change.what for change in changes).items())
            lines.append(
                f"{sequence}: "
                f"{', '.join(f'{kind} {count}' for kind, count in counts) or 'nothing changed'}"
            )
    return "; ".join(lines)


if __name__ == "__main__":
    main()
