"""Steps of learning: further days in, the localiser after each of them out (METHODS 11.4).

`supervised` makes a method learn days with known poses, by a strategy (strategies.py).
`self_trained` lets a site learn drives by its own pseudo-labels. `record` queries each localiser
with days that are never learned, and returns the results as the `Lifelong` artifact.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import travelled_m
from pipeline.core.progress import Progress
from pipeline.core.schemas import Lifelong
from pipeline.lifelong import pseudo_labels, update
from pipeline.lifelong.pseudo_labels import NoPseudoLabelsError
from pipeline.lifelong.strategies import SelfTrained
from pipeline.matching.incremental import in_order
from pipeline.matching.places import Places
from pipeline.matching.ranking import Localizer, Method, Model, Rows, TrainingSet
from pipeline.online import site_file
from pipeline.online.inputs import Scan
from pipeline.online.site import Site

STREETS = 4
"""The number of parts of the training day that are learned one after the other, like the steps of
InCloud (Knights et al., IROS 2022)."""
K = 25
"""How many places are ranked for each query."""


@dataclass(frozen=True)
class Step:
    """A localiser after it learned a day."""

    name: str
    """The day, or the part of a day."""
    localizer: Localizer
    places: Places
    """The places covered so far, whether the localiser learned them or not."""
    newest_ns: NDArray[np.int64]
    """(place,) the stamp of the newest view of each place so far."""
    bytes: int
    """The size of the model's arrays."""
    cpu_s: float
    """CPU seconds that learning the day took."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """After an update: the numbers of scans that were `queried`, `pseudo_labelled`, and labelled by
    a `wrong` pose, and of submaps that `changed`."""


def streets(name: str, views: Rows) -> dict[str, Rows]:
    """The views of the day `name`, cut into STREETS parts with equal lengths of path, by name."""
    path_m = travelled_m(views.world_T_anchor[:, :2, 3])
    ends = np.searchsorted(path_m, path_m[-1] * np.arange(1, STREETS) / STREETS)
    edges = [0, *ends, len(path_m)]
    loaded_views = Rows(views.images[:], views.stamps_ns, views.world_T_anchor)
    parts = {}
    for number, (start, end) in enumerate(pairwise(edges), start=1):
        parts[f"{name} {number}/{STREETS}"] = loaded_views.select(slice(start, end))
    return parts


def supervised(
    method: Method,
    strategy: Any,
    days: Mapping[str, Rows],
    places: Places,
    first_model: Model | None,
    progress: Progress,
) -> Iterator[Step]:
    """The localiser after each of the days, given by name, whose poses are known.

    `first_model` has learned the first day already; without it, the first day is learned here.
    `places` are the places at the start: the first day's, or none without a first model.
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


def self_trained(
    path: Path, strategy: SelfTrained, drives: Mapping[str, Sequence[Scan]], progress: Progress
) -> Iterator[Step]:
    """The localiser of the site at `path`, then the localiser after each drive that it learned.

    The site labels the drives itself; a drive without an accepted fix leaves it as it is. The steps
    have the names of the drives.
    """
    parts = site_file.read(path, views=True)
    site = Site(parts, threads=2)
    yield _of_site(parts.description.provenance.train, site, parts, 0.0)
    for name, scans in drives.items():
        start_s = time.process_time()
        counts = {"queried": len(scans), "pseudo_labelled": 0, "wrong": 0, "changed": 0}
        try:
            plan = update.planned_submaps(
                site, pseudo_labels.from_site(site, scans, strategy.target_precision)
            )
            wrong = int(plan.pseudo_labels.wrong[plan.used].sum())
            counts |= {
                "pseudo_labelled": len(plan.used),
                "wrong": wrong,
                "changed": len(plan.changed),
            }
            parts = update.updated(site, parts, plan, name, progress.part(name))
            site = Site(parts, threads=2)
        except NoPseudoLabelsError as error:
            progress.tell(f"{name}: {error}")
        yield _of_site(name, site, parts, time.process_time() - start_s, counts)


def _of_site(
    name: str,
    site: Site,
    parts: site_file.Parts,
    cpu_s: float,
    counts: Mapping[str, int] | None = None,
) -> Step:
    """The step that ends with this site, which was opened from `parts`."""
    return Step(
        name,
        site.localizer,
        site.places,
        newest_ns(update.learned_views(site, parts)),
        _size(parts.model),
        cpu_s,
        counts or {},
    )


def _size(model: Model) -> int:
    """The size of a model's arrays in bytes."""
    return sum(array.nbytes for array in model.values())


def record(
    steps: Iterator[Step],
    queries: Mapping[str, Rows],
    report_line: Callable[[str], None],
    order: str,
    strategy: str,
    correct_m: float,
) -> tuple[Lifelong, list[float]]:
    """Localise all queries, by day, after every step of learning.

    `report_line` is called with a line after each step. `order`, `strategy` and `correct_m` are
    written into the artifact as they are. Returns the artifact, and the CPU seconds that each step
    took.
    """
    query_xy_m = np.concatenate([views.world_T_anchor[:, :2, 3] for views in queries.values()])
    query_counts = [len(views.stamps_ns) for views in queries.values()]
    answers = []
    errors_m = []
    done_steps = list[Step]()
    for step in steps:
        rankings = [step.localizer(views, K) for views in queries.values()]
        answer = np.concatenate([ranking.places[:, 0] for ranking in rankings])
        answer_xy_m = np.concatenate([ranking.xy_m[:, 0] for ranking in rankings])
        true_place = step.places.at(query_xy_m)
        seen = true_place >= 0
        right = np.mean((answer == true_place)[seen])
        report_line(f"{step.name}: {right:.3f} right of {seen.sum()} seen")
        answers.append(answer)
        errors_m.append(np.linalg.norm(answer_xy_m - query_xy_m, axis=1))
        done_steps.append(step)
    last_places = done_steps[-1].places
    true_place = last_places.at(query_xy_m)
    is_known = np.array([step.places.at(query_xy_m) >= 0 for step in done_steps])
    lifelong = Lifelong(
        right=(np.array(answers) == true_place) & (true_place >= 0),
        error_m=np.array(errors_m),
        known_from=np.where(is_known.any(axis=0), is_known.argmax(axis=0), -1),
        day=np.repeat(np.arange(len(queries)), query_counts),
        xy_m=query_xy_m,
        place_xy_m=last_places.grid.centre(last_places.cells),
        newest_ns=done_steps[-1].newest_ns,
        order=order,
        strategy=strategy,
        steps=tuple(step.name for step in done_steps),
        queried=tuple(queries),
        learned_ns=tuple(int(step.newest_ns.max()) for step in done_steps),
        queried_ns=tuple(int(views.stamps_ns[0]) for views in queries.values()),
        correct_m=correct_m,
        places=tuple(len(step.places.cells) for step in done_steps),
        bytes=tuple(step.bytes for step in done_steps),
        counts=[dict(step.counts) for step in done_steps],
    )
    return lifelong, [step.cpu_s for step in done_steps]


def line(lifelong: Lifelong) -> str:
    """Summarise the results in a line: the share of right answers after the first and last step.

    Only queries count whose place was covered in some step.
    """
    is_covered = lifelong.known_from >= 0
    first = float(lifelong.right[0, is_covered].mean())
    last = float(lifelong.right[-1, is_covered].mean())
    return (
        f"{len(lifelong.steps)} steps to {lifelong.places[-1]} places: of {is_covered.sum()} "
        f"queries in learned places {first:.3f} right after the first step, {last:.3f} after the "
        "last"
    )
