"""Progress of long work: the share of it to do, where to store checkpoints, and how to show it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, TypeVar

from pipeline.core.settings import Positive, within

Item = TypeVar("Item")


@dataclass(frozen=True)
class Progress:
    """Shows nothing: the null object. Stages hand in a subclass that draws bars on a terminal."""

    budget: float = 1.0
    """Share of a method's own full training to run."""
    checkpoint: Path | None = None
    """File for the state of training, from which an interrupted run goes on after its last whole
    epoch."""

    def __post_init__(self) -> None:
        within("budget.share", self.budget, Positive)

    def part(self, name: str) -> Self:
        """The progress of a further part of the work, with a checkpoint of its own.

        That lies beside the first part's.
        """
        return replace(
            self,
            checkpoint=self.checkpoint
            and self.checkpoint.with_stem(f"{self.checkpoint.stem}-{name}"),
        )

    def done(self) -> None:
        """Remove the checkpoints of all parts."""
        if self.checkpoint:
            for part in self.checkpoint.parent.glob(f"{self.checkpoint.stem}*"):
                part.unlink()

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        """Yield the `total` items, showing progress under the name `what`."""
        yield from items

    def note(self, **numbers: float) -> None:
        """Show the latest numbers, such as a loss, beside the bar."""

    def tell(self, line: str) -> None:
        """Show a line to read at once, such as a warning or the reason for a wait."""
