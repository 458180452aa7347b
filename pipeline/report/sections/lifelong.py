"""The section on learning further days: what is known after each step, what is forgotten, and what
a step costs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import store
from pipeline.report.figures import lifelong
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.section import Illustration, Section
from pipeline.report.sections.lifelong_findings import findings
from pipeline.report.sections.lifelong_numbers import (
    GROWN,
    PROTOCOL,
    UPDATED,
    UPDATES,
    StrategyNumbers,
    by_order,
    strategies,
)
from pipeline.report.sections.lifelong_tables import of_order
from pipeline.report.study import Study
from pipeline.schemas_lifelong import LIFELONG
from pipeline.store import Artifact

DAY_NS = 86_400 * 10**9
DRAWN = {"recall_of_all": "recall of all", "forgetting": "forgetting"}


def section(study: Study, folder: Path) -> Section:
    """Draw its figures into `folder`."""
    every = strategies(study.rows)
    words = study.words
    orders = by_order(every)
    first = every[0].model
    shown = [
        illustrate(
            "lifelong_known",
            lifelong.known_places(_known(study, orders), study.train_xy_m),
            study,
            folder,
        )
    ]
    if aged := _aged(study, every):
        shown.append(
            illustrate("lifelong_ages", lifelong.ages(aged, study.train_xy_m), study, folder)
        )
    for model in dict.fromkeys(one.model for one in every):
        own = {
            order: [one for one in found if one.model == model] for order, found in orders.items()
        }
        drawn = list(
            _of_model(study, folder, model, {order: found for order, found in own.items() if found})
        )
        shown += [replace(one, on_page=model == first) for one in drawn]
    learned = {
        "train": words["train"],
        "learned": words["learned"],
        "updates": words.get("updates", []),
        "asked": words["tests"],
    }
    return Section(
        anchor(study.name, study.grid, "lifelong"),
        "lifelong",
        values={"study": study, "updates": UPDATES in orders},
        findings=findings(every),
        illustrations=shown,
        tables=[one for order, found in orders.items() for one in of_order(order, found)],
        folded=False,
        sources=[f"{study.artifacts.name}/lifelong/{study.name}/{study.grid}"],
        parameters={**learned, "budget": words["budget"]},
    )


def _of_model(
    study: Study, folder: Path, model: str, orders: dict[str, list[StrategyNumbers]]
) -> Iterator[Illustration]:
    """The figures of one model; those of days that nobody surveyed are two steps, which a table
    shows."""
    for order, found in orders.items():
        if order != UPDATES:
            matrices = {one.strategy: one.matrix(PROTOCOL) for one in found}
            figure = lifelong.matrices(
                matrices, found[0].steps, found[0].groups, f"{model}, {order}: recall by {PROTOCOL}"
            )
            named = {
                "name": f"lifelong_matrix_{model}_{order}",
                "model": model,
                "order": order,
                "protocol": PROTOCOL,
            }
            yield illustrate("lifelong_matrix", figure, study, folder, **named)
    numbers = {
        title: {
            (order, one.strategy): one.over(name, PROTOCOL)
            for order, found in orders.items()
            for one in found
        }
        for name, title in DRAWN.items()
    }
    steps = {order: found[0].steps for order, found in orders.items()}
    figure = lifelong.over_steps(steps, numbers, f"{model}: after each step, by {PROTOCOL}")
    yield illustrate(
        "lifelong_steps", figure, study, folder, name=f"lifelong_steps_{model}", model=model
    )


def _known(study: Study, orders: dict[str, list[StrategyNumbers]]) -> dict[str, lifelong.Known]:
    """Of each order that brings new places, where queries were taken and the step from which their
    place is known."""
    known = {}
    for order, (one, *_) in orders.items():
        artifact = _artifact(study, one)
        known[order] = lifelong.Known(artifact.load("xy_m"), artifact.load("known_from"), one.steps)
    return {order: one for order, one in known.items() if one.known_from.max() > 0} or known


def _aged(
    study: Study, every: Sequence[StrategyNumbers]
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Of the first model that learned further days, where its places lie and how old the newest
    view of each is at the end."""
    found = {}
    for one in every:
        if one.strategy in (GROWN, UPDATED) and one.order not in found:
            artifact = _artifact(study, one)
            newest_ns = artifact.load("newest_ns")
            days = np.rint((newest_ns.max() - newest_ns) / DAY_NS).astype(np.int64)
            if days.any():
                found[one.order] = artifact.load("place_xy_m"), days
    return found


def _artifact(study: Study, one: StrategyNumbers) -> Artifact:
    """Of the model's first seed."""
    return store.read(study.find("lifelong", f"{one.order}-{one.strategy}", one.model), LIFELONG)
