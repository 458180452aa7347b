"""The section on learning further days: recall after each step, forgetting, and costs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.schemas import Lifelong
from pipeline.core.store import Artifact
from pipeline.report.figures import lifelong
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.section import Illustration, Section
from pipeline.report.strategies import (
    GROWN,
    PROTOCOL,
    UPDATED,
    UPDATES,
    StrategyNumbers,
    by_order,
    findings,
    of_order,
    read_strategies,
)
from pipeline.report.study import Study

DAY_NS = 86_400 * 10**9
DRAWN = {"recall_of_all": "recall of all", "forgetting": "forgetting"}


def section(study: Study, folder: Path) -> Section:
    """Draw the figures into `folder` and return the section."""
    strategies = read_strategies(study.rows)
    settings = study.settings
    orders = by_order(strategies)
    first = strategies[0].model
    illustrations = [
        illustrate(
            "lifelong_known",
            lifelong.known_places(_first_known(study, orders), study.train_xy_m),
            study,
            folder,
        )
    ]
    if ages := _ages(study, strategies):
        illustrations.append(
            illustrate("lifelong_ages", lifelong.ages(ages, study.train_xy_m), study, folder)
        )
    for model in dict.fromkeys(strategy.model for strategy in strategies):
        model_orders = {
            order: model_group
            for order, group in orders.items()
            if (model_group := [strategy for strategy in group if strategy.model == model])
        }
        figures = list(_of_model(study, folder, model, model_orders))
        illustrations += [replace(illustration, on_page=model == first) for illustration in figures]
    sequences = {
        "train": settings.train_text,
        "learned": [*settings.learned],
        "updates": [*settings.updates],
        "asked": [*settings.tests],
    }
    return Section(
        anchor(study.name, study.grid, "lifelong"),
        "lifelong",
        values={"study": study, "updates": UPDATES in orders},
        findings=findings(strategies),
        illustrations=illustrations,
        tables=[table for order, group in orders.items() for table in of_order(order, group)],
        folded=False,
        sources=[study.folder("lifelong", study.grid)],
        parameters={**sequences, "budget": settings.budget},
    )


def _of_model(
    study: Study, folder: Path, model: str, orders: dict[str, list[StrategyNumbers]]
) -> Iterator[Illustration]:
    """The figures of one model.

    Days that nobody surveyed have two steps only, so no matrix of them is drawn.
    """
    for order, strategies in orders.items():
        if order != UPDATES:
            matrices = {strategy.name: strategy.matrix(PROTOCOL) for strategy in strategies}
            figure = lifelong.matrices(
                matrices,
                strategies[0].steps,
                strategies[0].groups,
                f"{model}, {order}: recall by {PROTOCOL}",
            )
            figure_words = {
                "name": f"lifelong_matrix_{model}_{order}",
                "model": model,
                "order": order,
                "protocol": PROTOCOL,
            }
            yield illustrate("lifelong_matrix", figure, study, folder, **figure_words)
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
    yield illustrate(
        "lifelong_steps", figure, study, folder, name=f"lifelong_steps_{model}", model=model
    )


def _first_known(
    study: Study, orders: dict[str, list[StrategyNumbers]]
) -> dict[str, lifelong.FirstKnown]:
    """For each order: where queries were taken, and the step from which their place is known.

    Orders that bring no new places are left out, unless none does.
    """
    first_known = {}
    for order, (strategy, *_) in orders.items():
        artifact = _artifact(study, strategy)
        first_known[order] = lifelong.FirstKnown(
            artifact.load("xy_m"), artifact.load("known_from"), strategy.steps
        )
    return {
        order: queries for order, queries in first_known.items() if queries.known_from.max() > 0
    } or first_known


def _ages(
    study: Study, strategies: Sequence[StrategyNumbers]
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """For each order: where the places lie, and the age in days of their newest view at the end.

    Taken from the first model that learned further days.
    """
    ages = {}
    for strategy in strategies:
        if strategy.name in (GROWN, UPDATED) and strategy.order not in ages:
            artifact = _artifact(study, strategy)
            newest_ns = artifact.load("newest_ns")
            days = np.rint((newest_ns.max() - newest_ns) / DAY_NS).astype(np.int64)
            if days.any():
                ages[strategy.order] = artifact.load("place_xy_m"), days
    return ages


def _artifact(study: Study, strategy: StrategyNumbers) -> Artifact:
    """The artifact of a strategy, for the model's first seed."""
    return store.read(
        study.find("lifelong", f"{strategy.order}-{strategy.name}", strategy.model), Lifelong
    )
