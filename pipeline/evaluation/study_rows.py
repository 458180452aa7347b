"""Rows of the table of results that need several evaluations: ageing over the year, methods against
each other, real changes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.ageing import Ageing, newness
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.events import NUMBERS as NEAR_CHANGES
from pipeline.evaluation.events import Bands, banded, distances
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.paired import COMPARED, compare, holm
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import Rows, row, several
from pipeline.evaluation.viewpoints import NUMBERS as VIEWPOINT_NUMBERS
from pipeline.evaluation.viewpoints import Judged
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
SHOWN = "change shown"
TO_COME = "change to come"


@dataclass(frozen=True)
class Answers:
    """The evaluations as driven of each method's own model, by method and test sequence in the
    order of the days."""

    evaluations: Mapping[str, Mapping[str, Evaluation]]
    held_out: Mapping[
        str, NDArray[np.float64]
    ]  # novelties (h,) in use of each method's held-out queries of training
    variants: Mapping[tuple[str, str], Mapping[str, Evaluation]] = field(default_factory=dict)
    """The same of method and variant; they are only compared with the reference."""

    @property
    def reference(self) -> str:
        """The study's first method, with which the others are compared."""
        return next(iter(self.evaluations))


def ageing_rows(answers: Answers, ageing: Ageing) -> Rows:
    """Each number of AGEING: the line through it over the days, at each sequence's day and as a
    slope; of the oracle too."""
    for protocol, number in AGEING:
        groups = {method: (number, group) for method, group in answers.evaluations.items()}
        if number.startswith("recall_at_1"):
            groups[ORACLE] = (
                number.replace("recall_at_1", ORACLE),
                answers.evaluations[answers.reference],
            )
        for method, (own, group) in groups.items():
            days = np.array([one.days for one in group.values()], np.float64)
            if number == "novelty_percentile":
                known = answers.held_out.get(method, np.empty(0))
                found = [(newness(one, known), np.nan, np.nan) for one in group.values()]
            else:
                found = [one.number(protocol, own) for one in group.values()]
            line = ageing.line(days, np.array([value for value, _, _ in found]))
            fitted = np.full((3, len(days)), np.nan) if line is None else line.at(days)
            for sequence, day, values, on_line in zip(group, days, found, fitted.T, strict=True):
                place = {"method": method, "sequence": sequence, "days": day}
                if method == ORACLE or number == "novelty_percentile":
                    yield place | row(number, protocol, *values)
                yield place | row(f"{number}_line", protocol, *on_line)
            if line is not None:
                slope = line.slope
                (low, high) = line.interval or (np.nan, np.nan)
                per = f"per_{PER_DAYS}_days"
                slopes = {
                    f"_{per}": PER_DAYS * np.array([slope, low, high]),
                    f"_theil_sen_{per}": PER_DAYS * line.middle_slope,
                }
                of_line: dict[str, Any] = slopes | {"_day_0": line.intercept, "_slope_p": line.p}
                if number != "novelty_percentile" and (lost := line.lost(ageing.loss)):
                    of_line["_retrain_after_days"] = lost
                yield from several(
                    {"method": method},
                    protocol,
                    {number + end: values for end, values in of_line.items()},
                )


def paired_rows(answers: Answers, bootstrap: Bootstrap) -> Rows:
    """Every model against the reference on the same queries: differences, p after Holm's
    correction, who alone is right."""
    first = answers.evaluations[answers.reference]
    against = {
        "case": f"against {answers.reference}",
        "change": "against",
        "kind": answers.reference,
    }
    own = {(method, ""): group for method, group in answers.evaluations.items()}
    for (method, variant), group in (own | dict(answers.variants)).items():
        common = {"method": method, "variant": variant} | against
        places = {
            sequence: common | {"sequence": sequence, "days": one.days}
            for sequence, one in group.items()
        }
        for protocol in PROTOCOLS if group is not first else ():
            found = {
                name: compare(one, first[name], protocol, bootstrap) for name, one in group.items()
            }
            for i, number in enumerate(COMPARED):
                p = holm(np.array([one.differences[i].p for one in found.values()]))
                for (sequence, one), corrected in zip(found.items(), p, strict=True):
                    difference = (
                        one.differences[i].value,
                        one.differences[i].low,
                        one.differences[i].high,
                    )
                    numbers = {
                        f"{number}_difference": difference,
                        f"{number}_difference_p": corrected,
                    }
                    yield from several(places[sequence], protocol, numbers)
            for sequence, one in found.items():
                alone = {
                    "only_this_right": one.only_this,
                    "only_reference_right": one.only_reference,
                }
                yield from several(places[sequence], protocol, alone)


def event_rows(
    answers: Answers, changes: Mapping[str, Iterable[Change]], bands: Bands, bootstrap: Bootstrap
) -> Rows:
    """All test sequences together, by the distance to the nearest real change that shows, and to
    one still to come.

    `changes` of each sequence are those that show on its day. `level` of a row is the farther edge
    of its band.
    """
    listed = {sequence: list(some) for sequence, some in changes.items()}
    first = answers.evaluations[answers.reference]
    away_m = distances({name: one.xy_m for name, one in first.items()}, listed, bands.kinds)
    for kind in bands.kinds:
        yield row(
            f"{kind}_changes",
            "",
            len({one for some in listed.values() for one in some if one.what == kind}),
        )
    for sequence, (shown_m, _) in away_m.items():
        near = first[sequence].cells.seen & (shown_m <= bands.edges_m[-1])
        yield {"sequence": sequence} | row("seen_near_a_change", "cells", near.sum())
    for method, group in answers.evaluations.items():
        for protocol in PROTOCOLS:
            for i, when in enumerate((SHOWN, TO_COME)):
                found = banded(
                    [*group.values()],
                    [away_m[name][i] for name in group],
                    bands,
                    protocol,
                    bootstrap,
                )
                for band, edge_m in enumerate((*bands.edges_m, np.inf)):
                    place = {
                        "method": method,
                        "case": f"{when}, {bands.names[band]}",
                        "change": when,
                        "level": edge_m,
                    }
                    counts = {"seen": found.seen[band], "unseen": found.unseen[band]}
                    yield from several(
                        place,
                        protocol,
                        counts | dict(zip(NEAR_CHANGES, found.values[band], strict=True)),
                    )


def viewpoint_rows(judged: Judged) -> Rows:
    """One model on one sequence matched with itself, from each heading between those of the
    reference."""
    for heading_deg, values in zip(judged.headings_deg, judged.values, strict=True):
        place = {
            "case": f"viewpoint {heading_deg:g}°",
            "change": "viewpoint",
            "level": float(heading_deg),
        }
        yield from several(place, "distance", dict(zip(VIEWPOINT_NUMBERS, values, strict=True)))
    numbers = {"queries": judged.valid.sum(), "bytes_per_place": judged.bytes_per_place}
    yield from several({"case": "viewpoint", "change": "viewpoint of all"}, "distance", numbers)
