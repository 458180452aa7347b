"""Rows of the table of results that one evaluation does not give.

Ageing over the year, methods against each other, real changes, viewpoints, reconstructions.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.ageing import Ageing, newness
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.events import NUMBERS as NEAR_CHANGES
from pipeline.evaluation.events import Bands, distances, judge_by_band
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.paired import COMPARED, compare, holm
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import TableRows, number_rows, row
from pipeline.evaluation.viewpoints import NUMBERS as VIEWPOINT_NUMBERS
from pipeline.evaluation.viewpoints import ViewpointMatches
from pipeline.formats.changes import Change

AGEING = (
    ("cells", "recall_at_1_same_heading"),
    ("cells", "auc_top1"),
    ("distance", "auroc"),
    ("distance", "novelty_percentile"),
    ("cells", "recall_at_1"),
    ("cells", "auroc"),
)
"""Protocol and number that are followed over the days; the first is the cleanest: neither new nor
reversed streets touch it."""
PER_DAYS = 100  # slopes are of so many days
ORACLE = "oracle"
RECONSTRUCTION = ("held_out_error", "black_error")
SHOWN = "change shown"
TO_COME = "change to come"


@dataclass(frozen=True)
class Answers:
    """The evaluations as driven of each method's own model.

    By method and test sequence, in the order of the days.
    """

    evaluations: Mapping[str, Mapping[str, Evaluation]]
    held_out: Mapping[str, NDArray[np.float64]]
    """Novelties (h,) in use of each method's held-out queries of training."""
    variants: Mapping[tuple[str, str], Mapping[str, Evaluation]] = field(default_factory=dict)
    """The same of method and variant; they are only compared with the reference."""

    @property
    def reference(self) -> str:
        """The study's first method, with which the others are compared."""
        return next(iter(self.evaluations))


def ageing_rows(answers: Answers, ageing: Ageing) -> TableRows:
    """Rows of each number of AGEING: its line at each sequence's day, and the line's slope.

    Those that the oracle has too are followed for it as well.
    """
    for protocol, number in AGEING:
        groups = {method: (number, group) for method, group in answers.evaluations.items()}
        if number.startswith("recall_at_1"):
            groups[ORACLE] = (
                number.replace("recall_at_1", ORACLE),
                answers.evaluations[answers.reference],
            )
        for method, (group_number, group) in groups.items():
            days = np.array([evaluation.days for evaluation in group.values()], np.float64)
            if number == "novelty_percentile":
                held_out_novelty = answers.held_out.get(method, np.empty(0))
                estimates = [
                    (newness(evaluation, held_out_novelty), np.nan, np.nan)
                    for evaluation in group.values()
                ]
            else:
                estimates = [
                    evaluation.number(protocol, group_number) for evaluation in group.values()
                ]
            line = ageing.line(days, np.array([value for value, _, _ in estimates]))
            fitted = np.full((3, len(days)), np.nan) if line is None else line.at(days)
            for sequence, day, values, on_line in zip(
                group, days, estimates, fitted.T, strict=True
            ):
                place = {"method": method, "sequence": sequence, "days": day}
                if method == ORACLE or number == "novelty_percentile":
                    yield place | row(number, protocol, *values)
                yield place | row(f"{number}_line", protocol, *on_line)
            if line is not None:
                slope = line.slope
                (low, high) = line.interval or (np.nan, np.nan)
                per_days = f"per_{PER_DAYS}_days"
                slopes = {
                    f"_{per_days}": PER_DAYS * np.array([slope, low, high]),
                    f"_theil_sen_{per_days}": PER_DAYS * line.middle_slope,
                }
                of_line: dict[str, Any] = slopes | {"_day_0": line.intercept, "_slope_p": line.p}
                if number != "novelty_percentile" and (lost := line.lost(ageing.loss)):
                    of_line["_retrain_after_days"] = lost
                yield from number_rows(
                    {"method": method},
                    protocol,
                    {number + end: values for end, values in of_line.items()},
                )


def paired_rows(answers: Answers, bootstrap: Bootstrap) -> TableRows:
    """Rows of every model against the reference on the same queries.

    Differences, p after Holm's correction, and how many queries only one of the two answers right.
    """
    reference = answers.evaluations[answers.reference]
    against = {
        "case": f"against {answers.reference}",
        "change": "against",
        "kind": answers.reference,
    }
    own_recipes = {(method, ""): group for method, group in answers.evaluations.items()}
    for (method, variant), group in (own_recipes | dict(answers.variants)).items():
        common = {"method": method, "variant": variant} | against
        places = {
            sequence: common | {"sequence": sequence, "days": evaluation.days}
            for sequence, evaluation in group.items()
        }
        for protocol in PROTOCOLS if group is not reference else ():
            comparisons = {
                sequence: compare(evaluation, reference[sequence], protocol, bootstrap)
                for sequence, evaluation in group.items()
            }
            for i, number in enumerate(COMPARED):
                differences = [comparison.differences[i] for comparison in comparisons.values()]
                corrected_p = holm(np.array([difference.p for difference in differences]))
                for sequence, difference, p in zip(
                    comparisons, differences, corrected_p, strict=True
                ):
                    numbers = {
                        f"{number}_difference": (
                            difference.value,
                            difference.low,
                            difference.high,
                        ),
                        f"{number}_difference_p": p,
                    }
                    yield from number_rows(places[sequence], protocol, numbers)
            for sequence, comparison in comparisons.items():
                right_alone = {
                    "only_this_right": comparison.only_this,
                    "only_reference_right": comparison.only_reference,
                }
                yield from number_rows(places[sequence], protocol, right_alone)


def event_rows(
    answers: Answers, changes: Mapping[str, Iterable[Change]], bands: Bands, bootstrap: Bootstrap
) -> TableRows:
    """Rows of all test sequences together, by the distance to the nearest real change.

    Of changes that show, and of those still to come. `changes` of each sequence are those that show
    on its day. `level` of a row is the farther edge of its band.
    """
    changes_of = {sequence: list(in_sequence) for sequence, in_sequence in changes.items()}
    reference = answers.evaluations[answers.reference]
    xy_m = {sequence: evaluation.xy_m for sequence, evaluation in reference.items()}
    away_m = distances(xy_m, changes_of, bands.kinds)
    for kind in bands.kinds:
        of_kind = {
            change
            for sequence_changes in changes_of.values()
            for change in sequence_changes
            if change.what == kind
        }
        yield row(f"{kind}_changes", "", len(of_kind))
    for sequence, (shown_m, _) in away_m.items():
        is_near = reference[sequence].cells.seen & (shown_m <= bands.edges_m[-1])
        yield {"sequence": sequence} | row("seen_near_a_change", "cells", is_near.sum())
    for method, group in answers.evaluations.items():
        for protocol in PROTOCOLS:
            for i, change_time in enumerate((SHOWN, TO_COME)):
                in_bands = judge_by_band(
                    [*group.values()],
                    [away_m[name][i] for name in group],
                    bands,
                    protocol,
                    bootstrap,
                )
                for band, edge_m in enumerate((*bands.edges_m, np.inf)):
                    place = {
                        "method": method,
                        "case": f"{change_time}, {bands.names[band]}",
                        "change": change_time,
                        "level": edge_m,
                    }
                    counts = {"seen": in_bands.seen[band], "unseen": in_bands.unseen[band]}
                    yield from number_rows(
                        place,
                        protocol,
                        counts | dict(zip(NEAR_CHANGES, in_bands.values[band], strict=True)),
                    )


def viewpoint_rows(judged: ViewpointMatches) -> TableRows:
    """Rows of one model on one sequence matched with itself, a row a number and query heading."""
    for heading_deg, values in zip(judged.headings_deg, judged.values, strict=True):
        place = {
            "case": f"viewpoint {heading_deg:g}°",
            "change": "viewpoint",
            "level": float(heading_deg),
        }
        yield from number_rows(place, "distance", dict(zip(VIEWPOINT_NUMBERS, values, strict=True)))
    numbers = {"queries": judged.valid.sum(), "bytes_per_place": judged.bytes_per_place}
    yield from number_rows({"case": "viewpoint", "change": "viewpoint of all"}, "distance", numbers)


def reconstruction_rows(model: Mapping[str, NDArray[Any]]) -> TableRows:
    """Rows of how well a network draws held-out images of training, in the round that was kept.

    Its mean squared error, and a black image's on the same images; none for a method without them.
    """
    for name in RECONSTRUCTION:
        if f"curves/{name}" in model:
            of_round = model[f"curves/{name}"][int(model["best_epoch"])]
            yield {"case": "viewpoint", "change": "viewpoint of all"} | row(name, "", of_round)
