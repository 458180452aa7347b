"""Courses: which days a localiser of a study learns, one after the other, from its artifacts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline.core import schemas, store
from pipeline.core.progress import Progress
from pipeline.lifelong import drives
from pipeline.lifelong.steps import Step, streets, surveyed, updated
from pipeline.lifelong.strategies import Updated
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Rows
from pipeline.online.pack import Packing, Trained

Order = Literal["days", "streets", "updates"]


@dataclass(frozen=True)
class Course:
    """The days that one model of a study learns."""

    trained: Trained
    """The model, and the artifacts of its first day; those of other days lie beside them."""
    learned: Sequence[str]
    """Sequences to learn after the first."""

    def steps(
        self,
        order: Order,
        strategy: Any,
        method: Method,
        packing: Packing,
        scratch: Path,
        progress: Progress,
    ) -> Iterator[Step]:
        """The localiser after each step, in an order; updates pack a site into `scratch` first."""
        if order == "updates":
            return self.updates(strategy, packing, scratch, progress)
        return self.surveys(strategy, method, order, progress)

    def surveys(
        self, strategy: Any, method: Method, order: Order, progress: Progress
    ) -> Iterator[Step]:
        """The localiser after each surveyed day, or after each part of the training day.

        The first day is trained already.
        """
        train = self.trained.train
        folder = self.trained.views.parent
        days = {name: Rows.read(folder / f"{name}.zarr") for name in (train, *self.learned)}
        places = Places.of(store.read(self.trained.labels, schemas.Labels))
        if order == "streets":
            no_places = Places(places.grid, places.cells[:0])
            return surveyed(
                method, strategy, streets(train, days[train]), no_places, None, progress
            )
        first_model = store.read_model(self.trained.model)
        return surveyed(method, strategy, days, places, first_model, progress)

    def updates(
        self, strategy: Updated, packing: Packing, scratch: Path, progress: Progress
    ) -> Iterator[Step]:
        """The localiser after each day that the model's site learns by itself."""
        site = scratch / "first.site"
        progress.tell(packing.pack(self.trained, site, progress))
        days = drives.read(self.trained.scans.parent, self.trained.submaps.parent, self.learned)
        return updated(site, strategy, days, progress)
