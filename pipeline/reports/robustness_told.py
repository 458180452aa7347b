"""What a section on one alteration is made from, and what it is made of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from pipeline.reports.robustness_answers import Answers
from pipeline.reports.section import Shown
from pipeline.reports.style import save
from pipeline.reports.table import Table

OVER = "± over the test sequences"
BY_CELLS = f"Every kind of query, by cells ({OVER}; those over repeats and seeds are of the first number)"
BY_DISTANCE = f"Every kind of query, by distance, with the headings told of what is placed right ({OVER})"


@dataclass(frozen=True)
class Study:
    """What a section is made from."""

    folder: Path
    where: str
    """Such as campus."""
    answers: Answers
    simulated: bool
    stress: Mapping[str, str]
    """Sequence to what makes it hard."""

    def shown(self, stem: str, fig: Figure, title: str, read: str, *says: str) -> Shown:
        """A figure, drawn, with its sentences."""
        path = save(fig, self.folder / f"{stem}.svg")
        return Shown(path.name, title, read, " ".join(filter(None, says)))


@dataclass(frozen=True)
class Told:
    """What one alteration has to say."""

    title: str
    question: str
    answer: Sequence[str]
    figures: Sequence[Shown]
    tables: Sequence[tuple[str, Table]]
