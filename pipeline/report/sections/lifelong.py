"""The section on learning further days: recall after each step, forgetting, and costs.

In: a study whose models learn one day after another by several strategies, in several orders of
days. Out: the section, with its figures drawn.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Lifelong
from pipeline.report import tables
from pipeline.report.figures import lifelong
from pipeline.report.result import grouped
from pipeline.report.section import Illustration, Section, illustrate, section_of
from pipeline.report.strategies import (
    INCREMENTAL,
    PROTOCOL,
    SELF_TRAINED,
    SELF_TRAINING,
    Strategy,
    findings,
    read_strategies,
)
from pipeline.report.study import StudyResults

DAY_NS = 86_400 * 10**9
DRAWN = {"recall_of_all": "recall of all", "forgetting": "forgetting"}


def section(study: StudyResults, folder: Path) -> Section:
    """Draw the figures into `folder` and return the section."""
    strategies = read_strategies(study.rows)
    orders = grouped(strategies, "order")
    draw = partial(illustrate, study, folder)
    known_places = lifelong.known_places(_first_known(study, orders), study.train_xy_m)
    illustrations = [draw("lifelong_known", known_places)]
    if ages := _ages(study, strategies):
        illustrations.append(draw("lifelong_ages", lifelong.ages(ages, study.train_xy_m)))
    for model, group in grouped(strategies, "model").items():
        on_page = model == strategies[0].model
        figures = _of_model(study, folder, model, grouped(group, "order"))
        illustrations += [replace(figure, on_page=on_page) for figure in figures if figure]
    settings = study.settings
    return section_of(
        study,
        "lifelong",
        {"self_training": SELF_TRAINING in orders},
        findings=findings(strategies),
        illustrations=illustrations,
        tables=[
            table for order, group in orders.items() for table in tables.of_order(order, group)
        ],
        sources=[study.folder("lifelong", study.grid)],
        parameters={
            "train": settings.train_text,
            "learned": [*settings.learned],
            "self_training": [*settings.self_training],
            "queried": [*settings.tests],
            "budget": settings.budget,
        },
    )


def _of_model(
    study: StudyResults, folder: Path, model: str, orders: Mapping[str, Sequence[Strategy]]
) -> Iterator[Illustration | None]:
    """The figures of one model.

    Days without reference poses have two steps only, so no matrix of them is drawn.
    """
    draw = partial(illustrate, study, folder)
    for order, strategies in orders.items():
        if order == SELF_TRAINING:
            continue
        recalls = {strategy.name: strategy.matrix(PROTOCOL) for strategy in strategies}
        heading = f"{model}, {order}: recall by {PROTOCOL}"
        first = strategies[0]
        yield draw(
            "lifelong_matrix",
            lifelong.matrices(recalls, first.steps, first.groups, heading),
            name=f"lifelong_matrix_{model}_{order}",
            model=model,
            order=order,
            protocol=PROTOCOL,
        )
    numbers = {
        title: {
            (order, strategy.name): strategy.over(name, PROTOCOL)
            for order, strategies in orders.items()
            for strategy in strategies
        }
        for name, title in DRAWN.items()
    }
    steps = {order: strategies[0].steps for order, strategies in orders.items()}
    figure = lifelong.over_steps(steps, numbers, f"{model}: after each step, by {PROTOCOL}")
    yield draw("lifelong_steps", figure, name=f"lifelong_steps_{model}", model=model)


def _first_known(
    study: StudyResults, orders: Mapping[str, Sequence[Strategy]]
) -> dict[str, lifelong.FirstKnown]:
    """For each order: where queries were taken, and the step from which their place is known.

    Orders that add no new places are left out, unless no order adds any.
    """
    first_known = {}
    for order, (strategy, *_) in orders.items():
        places = _artifact(study, strategy)
        first_known[order] = lifelong.FirstKnown(
            places.load("xy_m"), places.load("known_from"), strategy.steps
        )
    incremental = {order: known for order, known in first_known.items() if known.step.max() > 0}
    return incremental or first_known


def _ages(
    study: StudyResults, strategies: Sequence[Strategy]
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """For each order: the positions of places (n, 2), and the ages of their newest views (n,).

    Ages are in days after the last step, of the first model that learned further days. Orders after
    which all views are of one day are left out.
    """
    ages = {}
    for strategy in strategies:
        if strategy.name in (INCREMENTAL, SELF_TRAINED) and strategy.order not in ages:
            places = _artifact(study, strategy)
            newest_ns = places.load("newest_ns")
            days = np.rint((newest_ns.max() - newest_ns) / DAY_NS).astype(np.int64)
            if days.any():
                ages[strategy.order] = places.load("place_xy_m"), days
    return ages


def _artifact(study: StudyResults, strategy: Strategy) -> Lifelong:
    """The artifact of a strategy, for the model's first seed."""
    name = f"{strategy.order}-{strategy.name}"
    return study.artifact(Lifelong, "lifelong", name, strategy.model)
