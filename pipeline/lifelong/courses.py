"""Courses: the days that a model of a study learns, and the localiser after each of them.

The stage `lifelong` runs a course in one of three orders (METHODS 11.4):

- `days`: surveyed days, one after the other;
- `streets`: the training day in parts;
- `updates`: days that nobody surveyed, which the model's site learns by itself.
"""

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
    """The sequences to learn after the first day."""

    def steps(
        self,
        order: Order,
        strategy: Any,
        method: Method,
        packing: Packing,
        scratch: Path,
        progress: Progress,
    ) -> Iterator[Step]:
        """The localiser after each step of an order.

        `strategy` says how a step is learned (strategies.py). For `updates` the model is first
        packed into a site, in the folder `scratch`.
        """
        if order == "updates":
            return self.updates(strategy, packing, scratch, progress)
        return self.surveys(strategy, method, order, progress)

    def surveys(
        self, strategy: Any, method: Method, order: Order, progress: Progress
    ) -> Iterator[Step]:
        """The localiser after each surveyed day, the first of which is trained already.

        In the order `streets` it is the localiser after each part of the training day, the first
        of which is to be trained.
        """
        train = self.trained.train
        folder = self.trained.views.parent
        days = {name: Rows.read(folder / f"{name}.zarr") for name in (train, *self.learned)}
        places = Places.of(store.read(self.trained.labels, schemas.Labels))
        if order == "streets":
            parts = streets(train, days[train])
            no_places = Places(places.grid, places.cells[:0])
            return surveyed(method, strategy, parts, no_places, None, progress)
        first_model = store.read_model(self.trained.model)
        return surveyed(method, strategy, days, places, first_model, progress)

    def updates(
        self, strategy: Updated, packing: Packing, scratch: Path, progress: Progress
    ) -> Iterator[Step]:
        """The localiser of the model's site after each day that the site learns by itself."""
        site = scratch / "first.site"
        progress.tell(packing.pack(self.trained, site, progress))
        days = drives.read(self.trained.scans.parent, self.trained.submaps.parent, self.learned)
        return updated(site, strategy, days, progress)
