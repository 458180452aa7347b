"""Stage `events`: writes what has changed in the world between training and each sequence's day.

A simulated world knows its own events; those of a recorded world come from a csv that the user
wrote. A study of robustness compares the answers near and far from these changes.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from pipeline.formats.changes import write_changes
from stages import EachSequence, each_sequence, stage
from stages.logs import DataSet, world_of


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/events.yaml."""

    dataset: DataSet
    world: DictConfig
    train: str
    root: str | None = None
    """Folder of the recorded logs; None for a simulated world."""


@stage("events")
def main(settings: Settings) -> str:
    world = world_of(settings.world, settings.dataset, settings.root)

    def write_changes_of(sequence: str, folder: Path) -> str:
        """Write the changes up to the day of one sequence."""
        changes = world.changes(settings.train, sequence)
        write_changes(folder / f"{sequence}.csv", changes)
        counts = sorted(Counter(change.what for change in changes).items())
        by_kind = ", ".join(f"{kind} {count}" for kind, count in counts)
        return f"{sequence}: {by_kind or 'nothing changed'}"

    return each_sequence(settings, write_changes_of, "look up changes")


if __name__ == "__main__":
    main()
