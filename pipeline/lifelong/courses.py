"""Courses: which days a localiser of a study learns, one after the other, from its artifacts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline import schemas, store
from pipeline.lifelong import drives
from pipeline.lifelong.steps import Step, streets, surveyed, updated
from pipeline.lifelong.strategies import Updated
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Rows
from pipeline.online.pack import Packing
from pipeline.running.progress import Progress
from pipeline.studies.layout import Layout

Order = Literal["days", "streets", "updates"]


@dataclass(frozen=True)
class Course:
    """The days that one model of a study learns."""

    layout: Layout
    study: str
    grid: str
    model: str
    train: str
    learned: Sequence[str]
    """Sequences to learn after `train`."""
    views: Path
    """Folder of what the method looks at."""

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
        first, *later = (
            Rows.read(self.views / f"{name}.zarr") for name in (self.train, *self.learned)
        )
        labels = self.layout.path("labels", self.study, self.grid, self.train)
        places = Places.of(store.read(labels, schemas.Labels))
        if order == "streets":
            no_places = Places(places.grid, places.cells[:0])
            return surveyed(method, strategy, streets(self.train, first), no_places, None, progress)
        days = dict(zip((self.train, *self.learned), (first, *later), strict=True))
        trained = self.layout.path("train", self.study, self.grid, self.model)
        return surveyed(method, strategy, days, places, store.read_model(trained), progress)

    def updates(
        self, strategy: Updated, packing: Packing, scratch: Path, progress: Progress
    ) -> Iterator[Step]:
        """The localiser after each day that the model's site learns by itself."""
        site = scratch / "first.site"
        progress.tell(packing.pack(f"{self.study}/{self.grid}/{self.model}", site, progress))
        return updated(site, strategy, drives.read(self.layout, self.study, self.learned), progress)
