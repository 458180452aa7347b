"""Steps of learning (METHODS 11.4): further days and a strategy in; the localiser after each out.

`surveyed` is of days whose poses are known, with a method and its model; `updated` of drives that a
site learns by itself.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.lifelong import adoption, growth
from pipeline.lifelong.adoption import NothingAdoptedError
from pipeline.lifelong.strategies import Updated
from pipeline.matching.growth import in_order
from pipeline.matching.places import Places
from pipeline.matching.ranking import Localizer, Method, Model, Rows, TrainingSet
from pipeline.online import site_file
from pipeline.online.inputs import Scan
from pipeline.online.site import Site

STREETS = 4
"""Parts of the training day that are learned one after the other, as InCloud's steps are (Knights
et al., IROS 2022)."""


@dataclass(frozen=True)
class Step:
    """A localiser after it learned a day."""

    name: str
    localizer: Localizer
    places: Places
    """The places surveyed by then, whether the localiser learned them or not."""
    newest_ns: NDArray[np.int64]
    """(place,) stamp of the newest view of each that was surveyed or adopted."""
    bytes: int
    """Of the model's arrays."""
    cpu_s: float
    """That learning the day took."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Of an update, scans asked and adopted, adopted at a wrong pose, submaps that changed."""


def streets(name: str, views: Rows) -> dict[str, Rows]:
    """The views of the day `name`, in STREETS parts of equal length of path, by part."""
    steps_m = np.linalg.norm(np.diff(views.world_T_anchor[:, :2, 3], axis=0), axis=1)
    path_m = np.cumsum([0, *steps_m])
    ends = np.searchsorted(path_m, path_m[-1] * np.arange(1, STREETS) / STREETS)
    loaded_views = Rows(views.images[:], views.stamps_ns, views.world_T_anchor)
    parts = zip([0, *ends], [*ends, len(path_m)], strict=True)
    return {
        f"{name} {number}/{STREETS}": loaded_views.some(slice(start, end))
        for number, (start, end) in enumerate(parts, start=1)
    }


def surveyed(
    method: Method,
    strategy: Any,
    days: Mapping[str, Rows],
    places: Places,
    first_model: Model | None,
    progress: Progress,
) -> Iterator[Step]:
    """The localiser after each day, by name, whose poses are known.

    `places` are those of the grid at the start: none, or the first day's where `first_model` has
    learned it already.
    """
    model: Model = {}
    learned_views: TrainingSet | None = None
    for number, (name, (new_views, places_by_then)) in enumerate(
        zip(days, in_order(days.values(), places), strict=True)
    ):
        start_s = time.process_time()
        part = progress.part(f"step{number}")
        if learned_views is None:
            model = first_model if first_model is not None else method.learn(*new_views, part)
            learned_views = new_views
        else:
            model = strategy.learn(method, model, learned_views, new_views, part)
            learned_views = TrainingSet.joined([learned_views, new_views])
        cpu_s = time.process_time() - start_s
        yield Step(
            name,
            method.localizer(model),
            places_by_then,
            newest_ns(learned_views),
            _size(model),
            cpu_s,
        )


def newest_ns(views: TrainingSet) -> NDArray[np.int64]:
    """The stamp (place,) of the newest view of each place."""
    stamps_ns = np.zeros(views.places.max() + 1, np.int64)
    np.maximum.at(stamps_ns, views.places, views.views.stamps_ns)
    return stamps_ns


def updated(
    path: Path, strategy: Updated, drives: Mapping[str, Sequence[Scan]], progress: Progress
) -> Iterator[Step]:
    """The site at `path`, then the site after each drive that it learned by itself.

    A drive of which it believes nothing leaves it as it is.
    """
    parts = site_file.read(path, views=True)
    site = Site(parts, threads=2)
    yield _of_site(parts.description.provenance.train, site, parts, 0.0)
    for name, scans in drives.items():
        start_s = time.process_time()
        counts = {"asked": len(scans), "adopted": 0, "wrong": 0, "changed": 0}
        try:
            plan = growth.planned(site, adoption.adopted(site, scans, strategy.promise))
            wrong = int(plan.adoption.wrong[plan.used].sum())
            counts |= {"adopted": len(plan.used), "wrong": wrong, "changed": len(plan.changed)}
            parts = growth.grown(site, parts, plan, name, progress.part(name))
            site = Site(parts, threads=2)
        except NothingAdoptedError as error:
            progress.tell(f"{name}: {error}")
        yield _of_site(name, site, parts, time.process_time() - start_s, counts)


def _of_site(
    name: str,
    site: Site,
    parts: site_file.Parts,
    cpu_s: float,
    counts: Mapping[str, int] | None = None,
) -> Step:
    """The step after which a site is as it is now; `parts` are those that it was opened from."""
    return Step(
        name,
        site.localizer,
        site.places,
        newest_ns(growth.learned_views(site, parts)),
        _size(parts.model),
        cpu_s,
        counts or {},
    )


def _size(model: Model) -> int:
    """Bytes of a model's arrays."""
    return sum(array.nbytes for array in model.values())
