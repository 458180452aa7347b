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

Order = Literal["days", "streets", "updates"]


@dataclass(frozen=True)
class Course:
    """The days of one model of a study."""

    artifacts: Path
    study: str
    grid: str
    model: str
    train: str
    learned: Sequence[str]
    """After `train`."""
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
        """The localiser after each day, in an order; for updates a site is packed into a folder
        first."""
        if order == "updates":
            return self.updates(strategy, packing, scratch, progress)
        return self.surveys(strategy, method, order, progress)

    def surveys(
        self, strategy: Any, method: Method, order: Order, progress: Progress
    ) -> Iterator[Step]:
        """A step a day whose poses are known, the first trained already; or a step for each part of
        the training day."""
        first, *later = (
            Rows.read(self.views / f"{name}.zarr") for name in (self.train, *self.learned)
        )
        labels = self.artifacts / "labels" / self.study / self.grid / f"{self.train}.zarr"
        places = Places.read(store.read(labels, schemas.LABELS))
        if order == "streets":
            none = Places(places.grid, places.cells[:0])
            return surveyed(method, strategy, streets(self.train, first), none, None, progress)
        days = dict(zip((self.train, *self.learned), (first, *later), strict=True))
        trained = self.artifacts / "train" / self.study / self.grid / f"{self.model}.safetensors"
        return surveyed(method, strategy, days, places, store.read_model(trained), progress)

    def updates(
        self, strategy: Updated, packing: Packing, scratch: Path, progress: Progress
    ) -> Iterator[Step]:
        """A step a day that the site of the model learns by itself."""
        site = scratch / "first.site"
        progress.tell(packing.pack(f"{self.study}/{self.grid}/{self.model}", site, progress))
        return updated(
            site, strategy, drives.read(self.artifacts, self.study, self.learned), progress
        )
