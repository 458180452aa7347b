"""The table of results: its columns, and the rows that one evaluation gives.

A row is one value of a metric with its 95 % interval. The other columns say which model it belongs
to, on which sequence, with which queries and by which protocol. Reports, figures and MLflow select
from these rows with `pick` and `indexed`; `results` and `study_rows` gather them.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.bootstrap import Estimate
from pipeline.evaluation.calibration import ece
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.numbers import (
    LEVEL_POSES,
    MEASURES,
    NUMBERS,
    POSES,
    SAME_HEADING_DEG,
    average,
)
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.perturbations import Case

TableRows = Iterator[dict[str, Any]]
"""Rows, each from column to value. Columns are left out that the caller adds to all rows, and those
that keep their default (see `table`)."""
COLUMN_TYPES: Mapping[str, type] = {
    "study": str,
    "dataset": str,
    "simulated": bool,
    "grid": str,
    "model": str,
    "method": str,
    "variant": str,
    "seed": int,
    "sequence": str,
    "days": float,
    "ask": str,
    "of": str,
    "at": float,
    "repeat": int,
    "protocol": str,
    "number": str,
    "value": float,
    "low": float,
    "high": float,
}
"""The columns of the table, each with its type.

- `model`: the method with its variant, such as `sci-4way-pose`; empty for a number of no model.
- `variant`: empty for a method with its own settings.
- `sequence`: empty for a number of all test sequences together.
- `ask`: the kind of queries, one of the names below; `of` and `at` say which of this kind.
- `number`: the name of the metric, such as `recall_at_1`; `protocol` says how answers are judged.
- `repeat`: the number of the repetition of a perturbation that is drawn at random.
- `low`, `high`: the bounds of the 95 % interval, NaN if there is none.
"""
COLUMNS = tuple(COLUMN_TYPES)
TEXT_COLUMNS = tuple(name for name, kind in COLUMN_TYPES.items() if kind is str)
FLOAT_COLUMNS = tuple(name for name, kind in COLUMN_TYPES.items() if kind is float)
UNPERTURBED = "unperturbed"
"""The unperturbed queries, and numbers that follow from them alone."""
STRESS = "stress"
"""The unperturbed queries of a stress sequence; `of` is what is hard about it."""
PERTURBED = "perturbed"
"""The queries with a perturbation: `of` names it, `at` is its strength."""
NOVELTY = "novelty"
"""The unperturbed queries, rejected by the kind of novelty `of`."""
AGAINST = "against"
"""The model minus the model `of`, on the same unperturbed queries."""
NEAR_CHANGE = "near a change"
"""The queries at most `at` metres from a change of the world that is shown or to come (`of`)."""
VIEWPOINT = "viewpoint"
"""A sequence matched with itself, from a heading of `at` degrees; from all of them without `of`."""
COURSE = "course"
"""After the step `at` of the course `of`: an order of further days, and a strategy."""
HEADING = "heading"
"""`of` of a viewpoint: the queries have one heading."""
WITH_SHADOW = " with shadow"
"""Ends `of` of a perturbation whose new walls hide what is behind them."""


def case_text(case: Case) -> str:
    """A case in a word or two: `turned 0`, `demolition 60°`, `construction 2 walls, shadow`.

    Empty for unperturbed queries.
    """
    detail = ""
    if case.change == "demolition":
        detail = f" {case.level:g}°"
    elif case.change == "construction":
        detail = f" {case.level:g} walls"
    elif case.change:
        detail = f" {case.repeat}"
    shadow = ", shadow" if case.shadow else ""
    return f"{case.change}{detail}{shadow}"


def case_columns(case: Case, stress: str = "") -> dict[str, Any]:
    """The columns that say what was done to the queries.

    `stress` is what is hard about their sequence; empty for a test sequence.
    """
    if case.change:
        of = case.change + WITH_SHADOW * case.shadow
        return {"ask": PERTURBED, "of": of, "at": case.level, "repeat": case.repeat}
    return {"ask": STRESS if stress else UNPERTURBED, "of": stress}


def evaluation_rows(
    evaluation: Evaluation,
    case: Case = Case(),  # noqa: B008 (frozen)
    stress: str = "",
) -> TableRows:
    """Rows of one case of an evaluation: counts, numbers with intervals, calibration, verdicts.

    For unperturbed queries, the caveats about the numbers and each kind of novelty have rows too.
    `stress` is what is hard about the sequence; empty for a test sequence.
    """
    columns = case_columns(case, stress)
    for protocol in PROTOCOLS:
        yield from number_rows(columns, protocol, _numbers(evaluation, protocol))
        if case.change:
            continue
        yield from number_rows(columns, protocol, evaluation.caveats(protocol))
        for kind, rejection, validation_precision in zip(
            evaluation.kinds,
            evaluation.protocol(protocol).rejection,
            evaluation.validation_precision,
            strict=True,
        ):
            measures = dict(zip(MEASURES, rejection, strict=True))
            measures["validation_precision"] = validation_precision
            yield from number_rows({"ask": NOVELTY, "of": kind}, protocol, measures)
    calibration = dict(zip(("ece_raw", "ece"), evaluation.calibration, strict=True))
    yield from number_rows(columns, "cells", calibration)
    counts = {name: queries.sum() for name, queries in evaluation.acceptance.items()}
    yield from number_rows(columns, "distance", counts)
    if evaluation.has_poses:
        verdicts = {f"{verdict}_99": count for verdict, count in evaluation.verdicts.items()}
        error = ece(evaluation.pose_probabilities, evaluation.pose_right)
        of_poses = {"pose_ece": error, "kept_precision": evaluation.kept_precision}
        yield from number_rows(columns, "distance", verdicts | of_poses)
        yield from number_rows(columns, "distance", evaluation.in_ellipsoids)


def _numbers(evaluation: Evaluation, protocol: str) -> dict[str, Any]:
    """Counts, acceptance and NUMBERS by one protocol, name to value or to value and bounds (3,).

    The numbers on poses are there only if the method estimates poses.
    """
    judgement = evaluation.protocol(protocol)
    numbers: dict[str, Any] = {
        "queries": len(judgement.seen),
        "seen": judgement.seen.sum(),
        "unseen": judgement.unseen.sum(),
        "threshold": evaluation.reject_from[0],
        "turned_share": average(np.abs(evaluation.turn_deg[judgement.seen]) > SAME_HEADING_DEG),
        "answered": judgement.answered,
        "validation_precision": evaluation.validation_precision[0],
        "target_precision": evaluation.target_precision,
    }
    for name, value_and_bounds in zip(NUMBERS, judgement.numbers, strict=True):
        if name in POSES and not evaluation.has_poses:
            continue
        if name == LEVEL_POSES and not evaluation.is_level:
            continue
        numbers[name] = value_and_bounds
    return numbers


def row(
    number: str, protocol: str, value: float, low: float = np.nan, high: float = np.nan
) -> dict[str, Any]:
    """The columns of one number: protocol, number, value, low and high."""
    return {
        "protocol": protocol,
        "number": number,
        "value": float(value),
        "low": float(low),
        "high": float(high),
    }


def number_rows(columns: Mapping[str, Any], protocol: str, numbers: Mapping[str, Any]) -> TableRows:
    """One row for each number, a value or a value with its bounds, and these columns."""
    for number, values in numbers.items():
        yield {**columns, **row(number, protocol, *np.atleast_1d(values))}


def placed(rows: TableRows, **columns: Any) -> TableRows:
    """The rows with these columns too."""
    return ({**columns, **own} for own in rows)


def table(rows: Iterable[Mapping[str, Any]], **common: Any) -> pd.DataFrame:
    """A frame of rows with all columns, each of its type; `common` values stand in each row."""
    defaults = dict.fromkeys(TEXT_COLUMNS, "") | {
        "simulated": False,
        "seed": 0,
        "days": np.nan,
        "ask": UNPERTURBED,
        "at": 0.0,
        "repeat": 0,
    }
    frame = pd.DataFrame([defaults | common | dict(columns) for columns in rows], columns=COLUMNS)
    has_variant = frame["variant"] != ""
    frame["model"] = frame["method"].where(~has_variant, frame["method"] + "-" + frame["variant"])
    return frame.astype(COLUMN_TYPES)


def pick(rows: pd.DataFrame, **entries: object) -> pd.DataFrame:
    """The rows that have these entries in these columns, in the order of the table."""
    for column, entry in entries.items():
        rows = rows[rows[column] == entry]
    return rows


def values(rows: pd.DataFrame) -> NDArray[np.float64]:
    """Value and interval of each row: (row, 3)."""
    return np.asarray(rows[["value", "low", "high"]], np.float64)


def indexed(rows: pd.DataFrame, *columns: str) -> dict[Any, Estimate]:
    """Map the entries of some columns to the value and interval of their row.

    A key is a tuple, or the entry itself for a single column. Where rows have equal keys the last
    one counts.
    """
    keys = rows[columns[0]] if len(columns) == 1 else zip(*(rows[c] for c in columns), strict=True)
    return dict(zip(keys, map(Estimate._make, values(rows).tolist()), strict=True))
