"""Rows of the table of results that take more than one evaluation.

In: a study's evaluations, of several methods on several test sequences. Out: rows on

- ageing: the line of a metric over the days since training (`ageing`),
- the difference of each method from the reference (`paired`),
- the queries near changes of the world (`events`),
- viewpoints and reconstructions, whose artifacts are no evaluations (`viewpoints`).

Rows of a single evaluation are made in `rows`, and `results` gathers all of them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.ageing import Ageing, newness
from pipeline.evaluation.bootstrap import Bootstrap, Estimate
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.events import NUMBERS as NEAR_CHANGES
from pipeline.evaluation.events import Bands, distances, judge_by_band
from pipeline.evaluation.paired import COMPARED, compare, holm
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import (
    AGAINST,
    HEADING,
    NEAR_CHANGE,
    VIEWPOINT,
    TableRows,
    number_rows,
    placed,
    row,
)
from pipeline.evaluation.viewpoint_matches import NUMBERS as VIEWPOINT_NUMBERS
from pipeline.evaluation.viewpoint_matches import ViewpointMatches
from pipeline.formats.changes import Change
from pipeline.studies.models import ModelName

AGEING = (
    ("cells", "recall_at_1_same_heading"),
    ("cells", "auc_top1"),
    ("distance", "auroc"),
    ("distance", "novelty_percentile"),
    ("cells", "recall_at_1"),
    ("cells", "auroc"),
)
"""Protocol and metric of each line over the days. The first metric is the cleanest, since it is not
affected by new streets or by streets driven in the other direction."""
PERCENTILE = "novelty_percentile"
"""The metric of AGEING that says how new queries look (`ageing.newness`)."""
PER_DAYS = 100
"""Slopes are the change in this many days."""
ORACLE = "oracle"
"""A value of the column `method`: each query is answered with the nearest training anchor."""
RECONSTRUCTION = ("validation_error", "black_error")
"""Curves of a training that become rows: see `reconstruction_rows`."""
SHOWN = "shown"
TO_COME = "to come"
"""Values of the column `of`: for queries near a change of the world that shows on their day, and
for queries near one that will show later."""


@dataclass(frozen=True)
class Answers:
    """The evaluations of a study at one cell size, of unperturbed queries."""

    evaluations: Mapping[str, Mapping[str, Evaluation]]
    """The evaluations of each method with its own settings, by test sequence, ordered by day."""
    validation: Mapping[str, NDArray[np.float64]]
    """Method to the novelties in use (h,) of queries on validation blocks of training."""
    variants: Mapping[ModelName, Mapping[str, Evaluation]] = field(default_factory=dict)
    """The evaluations of variants, and of answers with poses, by test sequence. They are only
    compared with the reference."""

    @property
    def reference(self) -> str:
        """The study's first method, with which the others are compared."""
        return next(iter(self.evaluations))

    def reference_of(self, model: ModelName) -> ModelName:
        """The reference of a model: the study's first method, with poses if both have poses."""
        for answers in model.plainer:
            reference = replace(answers, method=self.reference, variant="")
            if reference in self.variants and reference != model:
                return reference
        return ModelName(self.reference)


def ageing_rows(answers: Answers, ageing: Ageing) -> TableRows:
    """Rows of how each metric of AGEING changes over the days, for each method.

    Where the oracle has such a metric too, it has rows as well.
    """
    reference = answers.evaluations[answers.reference]
    for protocol, number in AGEING:
        values = {
            method: [evaluation.number(protocol, number) for evaluation in evaluations.values()]
            if number != PERCENTILE
            else [
                Estimate(newness(evaluation, answers.validation.get(method, np.empty(0))))
                for evaluation in evaluations.values()
            ]
            for method, evaluations in answers.evaluations.items()
        }
        if number.startswith("recall_at_1"):
            oracle = number.replace("recall_at_1", "oracle")
            values[ORACLE] = [
                evaluation.number(protocol, oracle) for evaluation in reference.values()
            ]
        for method, values_of_method in values.items():
            rows = _line_rows(protocol, number, reference, values_of_method, ageing)
            # An evaluation has rows of its own metrics already.
            is_new = method == ORACLE or number == PERCENTILE
            yield from (
                {"method": method, **columns}
                for columns in rows
                if is_new or columns["number"] != number
            )


def _line_rows(
    protocol: str,
    number: str,
    evaluations: Mapping[str, Evaluation],
    values: Sequence[Estimate],
    ageing: Ageing,
) -> TableRows:
    """Rows of one metric on each sequence, of the line at its day, and of the line's slope."""
    days = np.array([evaluation.days for evaluation in evaluations.values()], np.float64)
    line = ageing.line(days, np.array([estimate.value for estimate in values]))
    line_values = np.full((3, len(days)), np.nan) if line is None else line.at(days)
    for sequence, day, estimate, line_value in zip(
        evaluations, days, values, line_values.T, strict=True
    ):
        columns = {"sequence": sequence, "days": day}
        numbers = {number: estimate, f"{number}_line": line_value}
        yield from number_rows(columns, protocol, numbers)
    if line is None:
        return
    low, high = line.interval or (np.nan, np.nan)
    per_days = f"per_{PER_DAYS}_days"
    numbers = {
        f"{number}_{per_days}": PER_DAYS * np.array([line.slope, low, high]),
        f"{number}_theil_sen_{per_days}": PER_DAYS * line.middle_slope,
        f"{number}_day_0": line.intercept,
        f"{number}_slope_p": line.p,
    }
    if number != PERCENTILE and (lost_after_days := line.lost(ageing.loss)):
        numbers[f"{number}_retrain_after_days"] = lost_after_days
    yield from number_rows({}, protocol, numbers)


def paired_rows(answers: Answers, bootstrap: Bootstrap) -> TableRows:
    """Rows of every model against the reference on the same queries, a sequence at a time.

    They hold the differences, their p values after Holm's correction, and how many queries only one
    of the two models answers right.
    """
    models = {ModelName(method): by_sequence for method, by_sequence in answers.evaluations.items()}
    models |= answers.variants
    for model, evaluations in models.items():
        reference = answers.reference_of(model)
        if reference == model:
            continue
        for protocol in PROTOCOLS:
            rows = _comparison_rows(protocol, evaluations, models[reference], bootstrap)
            yield from placed(rows, **model.columns, ask=AGAINST, of=reference.name)


def _comparison_rows(
    protocol: str,
    evaluations: Mapping[str, Evaluation],
    reference: Mapping[str, Evaluation],
    bootstrap: Bootstrap,
) -> TableRows:
    """Rows of one model against the reference by one protocol; both by sequence."""
    places = [
        {"sequence": name, "days": evaluation.days} for name, evaluation in evaluations.items()
    ]
    comparisons = [
        compare(evaluation, reference[sequence], protocol, bootstrap)
        for sequence, evaluation in evaluations.items()
    ]
    for i, number in enumerate(COMPARED):
        differences = [comparison.differences[i] for comparison in comparisons]
        corrected_p = holm(np.array([difference.p for difference in differences]))
        for place, difference, p in zip(places, differences, corrected_p, strict=True):
            numbers = {
                f"{number}_difference": difference.estimate,
                f"{number}_difference_p": p,
            }
            yield from number_rows(place, protocol, numbers)
    for place, comparison in zip(places, comparisons, strict=True):
        right_alone = {
            "only_this_right": comparison.only_this,
            "only_reference_right": comparison.only_reference,
        }
        yield from number_rows(place, protocol, right_alone)


def event_rows(
    answers: Answers, changes: Mapping[str, Iterable[Change]], bands: Bands, bootstrap: Bootstrap
) -> TableRows:
    """Rows of all test sequences together, by the distance of queries to the nearest change.

    `changes` are, by sequence, those of the world that show on its day. Queries near a change that
    shows only in other sequences, and so is still to come, have rows of their own. `at` of a row is
    the farther edge of its band of distances.
    """
    changes_shown = {sequence: list(on_day) for sequence, on_day in changes.items()}
    reference = answers.evaluations[answers.reference]
    xy_m = {sequence: evaluation.xy_m for sequence, evaluation in reference.items()}
    distances_of = distances(xy_m, changes_shown, bands.kinds)
    all_changes = set(chain.from_iterable(changes_shown.values()))
    for kind in bands.kinds:
        count = sum(change.what == kind for change in all_changes)
        yield {"ask": NEAR_CHANGE} | row(f"{kind}_changes", "", count)
    for sequence, distances_m in distances_of.items():
        is_near = reference[sequence].cells.seen & (distances_m.shown_m <= bands.edges_m[-1])
        columns = {"sequence": sequence, "ask": NEAR_CHANGE, "of": SHOWN, "at": bands.edges_m[-1]}
        yield columns | row("seen_near_a_change", "cells", is_near.sum())
    times = enumerate((SHOWN, TO_COME))  # in the order of ChangeDistances
    for (method, evaluations), protocol, (i, change_time) in product(
        answers.evaluations.items(), PROTOCOLS, times
    ):
        results = judge_by_band(
            [*evaluations.values()],
            [distances_of[sequence][i] for sequence in evaluations],
            bands,
            protocol,
            bootstrap,
        )
        for band, edge_m in enumerate((*bands.edges_m, np.inf)):
            columns = {"method": method, "ask": NEAR_CHANGE, "of": change_time, "at": edge_m}
            counts = {"seen": results.seen[band], "unseen": results.unseen[band]}
            numbers = dict(zip(NEAR_CHANGES, results.values[band], strict=True))
            yield from number_rows(columns, protocol, counts | numbers)


def viewpoint_rows(matches: ViewpointMatches) -> TableRows:
    """Rows of one model on one sequence matched with itself, a row a metric and query heading."""
    for heading_deg, values in zip(matches.headings_deg, matches.values, strict=True):
        columns = {"ask": VIEWPOINT, "of": HEADING, "at": float(heading_deg)}
        yield from number_rows(
            columns, "distance", dict(zip(VIEWPOINT_NUMBERS, values, strict=True))
        )
    numbers = {"queries": matches.valid.sum(), "bytes_per_place": matches.bytes_per_place}
    yield from number_rows({"ask": VIEWPOINT}, "distance", numbers)


def reconstruction_rows(model: Mapping[str, NDArray[Any]]) -> TableRows:
    """Rows of a network's mean squared error in reconstructing validation images of training.

    Beside it stands the error of a black image. Both are of the round whose weights were kept. A
    method without a network that reconstructs has no such rows.
    """
    for name in RECONSTRUCTION:
        if f"curves/{name}" in model:
            error = model[f"curves/{name}"][int(model["best_epoch"])]
            yield {"ask": VIEWPOINT} | row(name, "", error)
