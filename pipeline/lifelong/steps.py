"""Steps: what a localiser is after each further day, by a strategy; and what it then answers of
other days (METHODS 11.4)."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.lifelong import adoption, growth
from pipeline.lifelong.adoption import NothingAdoptedError
from pipeline.lifelong.strategies import Updated
from pipeline.matching.growth import in_order
from pipeline.matching.places import Places
from pipeline.matching.ranking import Localizer, Method, Model, Rows, TrainingSet
from pipeline.online import site_file
from pipeline.online.inputs import Scan
from pipeline.online.site import Site
from pipeline.running.progress import Progress

STREETS = 4
"""Parts of the training day that are learned one after the other, as InCloud's steps are (Knights
et al., IROS 2022)."""


@dataclass(frozen=True)
class Step:
    """A localiser after it learned a day."""

    name: str
    localizer: Localizer
    places: Places
    """Those surveyed by then, whether it learned them or not."""
    newest_ns: NDArray[np.int64]
    """(place,) stamp of the newest view of each that was surveyed or adopted."""
    bytes: int
    cpu_s: float
    counts: Mapping[str, int] = field(default_factory=dict)
    """Of an update: scans asked and adopted, adopted at a wrong pose, and submaps that changed."""


def streets(name: str, views: Rows) -> dict[str, Rows]:
    """A day in STREETS parts of equal length."""
    way_m = np.cumsum(
        np.r_[0, np.linalg.norm(np.diff(views.world_T_anchor[:, :2, 3], axis=0), axis=1)]
    )
    ends = np.searchsorted(way_m, way_m[-1] * np.arange(1, STREETS) / STREETS)
    whole = Rows(views.images[:], views.stamps_ns, views.world_T_anchor)
    parts = zip([0, *ends], [*ends, len(way_m)], strict=True)
    return {f"{name} {i}/{STREETS}": whole.some(slice(*part)) for i, part in enumerate(parts, 1)}


def surveyed(
    method: Method,
    strategy: Any,
    days: Mapping[str, Rows],
    places: Places,
    first: Model | None,
    progress: Progress,
) -> Iterator[Step]:
    """A step a day whose poses are known; `places` are those of the grid, none or the first day's,
    and `first` its model."""
    known: TrainingSet | None = None
    model: Model = first or {}
    for number, (name, (new, by_then)) in enumerate(
        zip(days, in_order(days.values(), places), strict=True)
    ):
        start = time.process_time()
        part = progress.part(f"step{number}")
        if known is None:
            model = first if first is not None else method.learn(*new, part)
        else:
            model = strategy.learn(method, model, known, new, part)
        known = new if known is None else TrainingSet.joined([known, new])
        used_s = time.process_time() - start
        size = sum(array.nbytes for array in model.values())
        yield Step(name, method.localizer(model), by_then, newest_ns(known), size, used_s)


def newest_ns(views: TrainingSet) -> NDArray[np.int64]:
    """(place,) the stamp of the newest view of each."""
    found = np.zeros(views.places.max() + 1, np.int64)
    np.maximum.at(found, views.places, views.views.stamps_ns)
    return found


def updated(
    path: Path, strategy: Updated, drives: Mapping[str, Sequence[Scan]], progress: Progress
) -> Iterator[Step]:
    """The site at `path`, then a step a drive that it learned by itself; one of which it believes
    nothing changes nothing."""
    parts = site_file.read(path, views=True)
    site = Site(parts, threads=2)
    yield _of_site(str(parts.about["provenance"]["train"]), site, parts, 0.0)
    for name, scans in drives.items():
        start = time.process_time()
        counts = {"asked": len(scans), "adopted": 0, "wrong": 0, "changed": 0}
        try:
            plan = growth.planned(site, adoption.adopted(site, scans, strategy.promise))
            wrong = int(plan.adoption.wrong[plan.used].sum())
            counts |= {"adopted": len(plan.used), "wrong": wrong, "changed": len(plan.changed)}
            parts = growth.grown(site, parts, plan, name, progress.part(name))
            site = Site(parts, threads=2)
        except NothingAdoptedError as error:
            progress.tell(f"{name}: {error}")
        yield _of_site(name, site, parts, time.process_time() - start, counts)


def _of_site(
    name: str,
    site: Site,
    parts: site_file.Parts,
    cpu_s: float,
    counts: Mapping[str, int] | None = None,
) -> Step:
    size = sum(array.nbytes for array in parts.model.values())
    return Step(
        name,
        site.localizer,
        site.places,
        newest_ns(growth.learned(site, parts)),
        size,
        cpu_s,
        counts or {},
    )
