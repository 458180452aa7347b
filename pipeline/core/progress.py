"""`Progress`, which long work is given: how much of it to do, and where to report and to store it.

The library calls its methods as it works. This class shows nothing; the commands and the stages
hand in subclasses that draw bars on a terminal (`pipeline.cli.progress`, `stages.ProgressBar`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, TypeVar

from pipeline.core.settings import Positive, within

Item = TypeVar("Item")


@dataclass(frozen=True)
class Progress:
    """The share of the work, its checkpoint, and methods that show nothing (a null object)."""

    budget: float = 1.0
    """The share of a method's full training to run."""
    checkpoint: Path | None = None
    """File for the state of training: an interrupted run goes on from it after the last whole
    epoch."""

    def __post_init__(self) -> None:
        within("budget.share", self.budget, Positive)

    def part(self, name: str) -> Self:
        """The progress of a further part of the work, with a checkpoint beside this one's.

        `name` ends the name of its checkpoint.
        """
        if self.checkpoint is None:
            return replace(self)
        return replace(self, checkpoint=self.checkpoint.with_stem(f"{self.checkpoint.stem}-{name}"))

    def done(self) -> None:
        """Remove the checkpoints of all parts."""
        if self.checkpoint:
            for path in self.checkpoint.parent.glob(f"{self.checkpoint.stem}*"):
                path.unlink()

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        """Yield the items, `total` in all, and show progress under the name `what`."""
        yield from items

    def note(self, **numbers: float) -> None:
        """Show the latest numbers, such as a loss, beside the bar."""

    def tell(self, line: str) -> None:
        """Show a line to read at once, such as a warning or the reason for a wait."""
