"""Steps of learning: further days go in, the localiser after each of them comes out (METHODS 11.4).

`surveyed` makes a method learn days whose poses are known, by a strategy (strategies.py).
`updated` lets a site learn drives by itself.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import travelled_m
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
"""The training day is cut into so many parts, to be learned one after the other as InCloud's steps
are (Knights et al., IROS 2022)."""


@dataclass(frozen=True)
class Step:
    """A localiser after it learned a day."""

    name: str
    """The day, or the part of a day."""
    localizer: Localizer
    places: Places
    """The places surveyed by then, whether the localiser learned them or not."""
    newest_ns: NDArray[np.int64]
    """(place,) the stamp of the newest view of each place by then."""
    bytes: int
    """The size of the model's arrays."""
    cpu_s: float
    """CPU seconds that learning the day took."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """After an update: how many scans were `asked`, `adopted`, adopted at a `wrong` pose, and how
    many submaps `changed`."""


def streets(name: str, views: Rows) -> dict[str, Rows]:
    """The views of the day `name`, cut into STREETS parts of equal length of path, by part."""
    path_m = travelled_m(views.world_T_anchor[:, :2, 3])
    ends = np.searchsorted(path_m, path_m[-1] * np.arange(1, STREETS) / STREETS)
    edges = [0, *ends, len(path_m)]
    loaded_views = Rows(views.images[:], views.stamps_ns, views.world_T_anchor)
    parts = {}
    for number, (start, end) in enumerate(pairwise(edges), start=1):
        parts[f"{name} {number}/{STREETS}"] = loaded_views.some(slice(start, end))
    return parts


def surveyed(
    method: Method,
    strategy: Any,
    days: Mapping[str, Rows],
    places: Places,
    first_model: Model | None,
    progress: Progress,
) -> Iterator[Step]:
    """The localiser after each of the days, given by name, whose poses are known.

    `first_model` has learned the first day already; without one it is learned here. `places` are
    those at the start: the first day's, or none without a first model.
    """
    model: Model = {}
    learned_views: TrainingSet | None = None
    views_and_places = in_order(days.values(), places)
    for number, name in enumerate(days):
        new_views, places_by_then = next(views_and_places)
        start_s = time.process_time()
        part = progress.part(f"step{number}")
        if learned_views is None:
            model = method.learn(*new_views, part) if first_model is None else first_model
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
    """The localiser of the site at `path`, then that after each drive that it learned by itself.

    A drive of which it believes nothing leaves it as it is. The steps are named as the drives.
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
    """The step at whose end is this site, opened from `parts`."""
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
    """The size of a model's arrays in bytes."""
    return sum(array.nbytes for array in model.values())
