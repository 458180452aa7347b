"""The numbers that are followed over the days since training, and the line through each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline import store
from pipeline.evaluation.ageing import Ageing, Line, newness
from pipeline.matching.rejection import PREFIX
from pipeline.reports.result import Result, by_method, by_sequence

if TYPE_CHECKING:
    from pipeline.reports.study import Find

PER_DAYS = 100
"""Slopes are told of so many days."""
ORACLE = "oracle"
NOVELTY = "novelty_percentile"
HeldOut = Mapping[str, NDArray[np.float64]]
"""Method to the novelties (h,) in use of its held-out queries of training."""


@dataclass(frozen=True)
class Measure:
    """A number that is followed."""

    title: str
    protocol: str
    name: str
    """One of NUMBERS, or NOVELTY."""

    @property
    def key(self) -> str:
        """As MLflow names it: `cells_recall_at_1`."""
        return self.name if self.rises else f"{self.protocol}_{self.name}"

    @property
    def rises(self) -> bool:
        """With age; the others fall."""
        return self.name == NOVELTY


MEASURES = (
    Measure("recall@1, training's heading, by cells", "cells", "recall_at_1_same_heading"),
    Measure("AUC top-1, by cells", "cells", "auc_top1"),
    Measure("AUROC, by distance", "distance", "auroc"),
    Measure("novelty of the seen, percentile, by distance", "distance", NOVELTY),
    Measure("recall@1, by cells", "cells", "recall_at_1"),
    Measure("AUROC, by cells", "cells", "auroc"),
)
"""The first is the cleanest: neither new streets nor reversed ones touch it. Four are drawn."""
DRAWN = MEASURES[:4]


@dataclass(frozen=True)
class Aged:
    """One number of one method, or of the oracle, over the days."""

    method: str
    measure: Measure
    days: NDArray[np.float64]  # (sequence,)
    values: NDArray[np.float64]  # (sequence, 3) value and its own 95 % interval; NaN where there is none
    line: Line | None


def held_out(find: "Find", results: Sequence[Result]) -> dict[str, NDArray[np.float64]]:
    """The novelties that each model keeps of its held-out queries; none where it keeps none."""
    found = {}
    for method, group in by_method(results).items():
        model, kind = store.read_model(find("train", method=method)), group[0].evaluation.kinds[0]
        found[method] = np.asarray(model.get(f"{PREFIX}seen/{kind}", ()), np.float64)
    return found


def aged(results: Sequence[Result], known: HeldOut, ageing: Ageing) -> list[Aged]:
    """Each of MEASURES, of every method and of the oracle where it has one."""
    found = []
    for measure in MEASURES:
        groups = {method: (measure.name, group) for method, group in by_method(results).items()}
        if measure.name.startswith("recall_at_1"):
            firsts = [group[0] for group in by_sequence(results).values()]
            groups[ORACLE] = measure.name.replace("recall_at_1", ORACLE), firsts
        for method, (name, group) in groups.items():
            days = np.array([result.days for result in group], np.float64)
            values = np.array([_value(r, measure.protocol, name, known.get(method, np.empty(0))) for r in group], np.float64)
            found.append(Aged(method, measure, days, values, ageing.line(days, values[:, 0])))
    return found


def _value(result: Result, protocol: str, name: str, known: NDArray[np.float64]) -> tuple[float | None, ...]:
    """A number, its lowest and highest."""
    if name == NOVELTY:
        return newness(result.evaluation, known), None, None
    return result.number(protocol, name), *(result.interval(protocol, name) or (None, None))


def series(results: Sequence[Result], known: HeldOut, ageing: Ageing) -> dict[str, list[tuple[int, float]]]:
    """Of one method, as MLflow shows it: the percentile of novelty over the days, and each slope at the last of them."""
    told: dict[str, list[tuple[int, float]]] = {}
    for one in aged(results, known, ageing):
        key, line = f"ageing/{one.measure.key}", one.line
        if one.measure.rises and one.method != ORACLE:
            points = zip(one.days, one.values[:, 0], strict=True)
            told[key] = [(int(day), float(value)) for day, value in points if np.isfinite(value)]
        if line is None or one.method == ORACLE:
            continue
        low, high = line.interval or (None, None)
        slopes = {"": line.slope, "_low": low, "_high": high}
        found = {f"per_{PER_DAYS}_days{end}": slope * PER_DAYS for end, slope in slopes.items() if slope is not None}
        if not one.measure.rises and (lost := line.lost(ageing.loss)):
            found["retrain_after_days"] = lost[0]
        told |= {f"{key}_{end}": [(int(line.last_day), value)] for end, value in found.items()}
    return {name: points for name, points in told.items() if points}
