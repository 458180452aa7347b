"""The table of results: its columns, and the rows that one evaluation gives.

A row is one number with its 95 % interval. The other columns say of which model it is, on which
sequence, in which case of the queries (as driven, or altered) and by which protocol. Reports,
figures and MLflow select from these rows; `results` and `study_rows` gather them.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from pipeline.alterations import Case
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import LEVEL_POSES, MEASURES, NUMBERS, POSES, WITHIN
from pipeline.evaluation.protocols import PROTOCOLS

TableRows = Iterator[dict[str, Any]]
"""Rows, each from column to value. Columns are left out that the caller adds to all rows, and those
that keep their default (see `table`)."""
COLUMNS = (
    "study",
    "dataset",
    "simulated",
    "grid",
    "method",
    "variant",
    "seed",
    "sequence",
    "days",
    "case",
    "protocol",
    "number",
    "value",
    "low",
    "high",
)
"""The columns that `yearloc results --csv` prints.

- `case`: empty for queries as they were driven.
- `variant`: empty for a method with its own settings.
- `sequence`: empty for a number of all test sequences together.
- `low`, `high`: the bounds of the 95 % interval, NaN if there is none.
"""
CASE_COLUMNS = ("change", "level", "shadow", "repeat", "kind", "stress")
"""Further columns, the parts of a case, so that nobody has to take its text apart.

- `change`: the alteration of the queries; or what else a row compares, such as `change shown`: the
  queries near a change of the world.
- `level`: how strong the alteration is; or how far such a change is away at most, in metres.
- `shadow`: whether new walls hide what is behind them.
- `repeat`: the number of the repetition.
- `kind`: the kind of novelty; or the method that is compared with.
- `stress`: what is hard about a stress sequence.
"""
TEXT_COLUMNS = (
    "study",
    "dataset",
    "grid",
    "method",
    "variant",
    "sequence",
    "case",
    "protocol",
    "number",
    "change",
    "kind",
    "stress",
)
FLOAT_COLUMNS = ("days", "level", "value", "low", "high")
COLUMN_TYPES: Mapping[str, type] = {
    **dict.fromkeys(TEXT_COLUMNS, str),
    **dict.fromkeys(FLOAT_COLUMNS, float),
    **dict.fromkeys(("seed", "repeat"), int),
    **dict.fromkeys(("simulated", "shadow"), bool),
}
"""The type of each column."""


def case_text(case: Case) -> str:
    """A case in a word or two: `turned 0`, `demolition 60°`, `construction 2 walls, shadow`.

    Empty for queries as driven.
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


def case_columns(case: Case) -> dict[str, Any]:
    """The columns that say what was done to the queries."""
    return {
        "case": case_text(case),
        "change": case.change,
        "level": case.level,
        "shadow": case.shadow,
        "repeat": case.repeat,
    }


def evaluation_rows(evaluation: Evaluation, case: Case = Case()) -> TableRows:  # noqa: B008 (frozen)
    """Rows of one case of an evaluation: counts, numbers with intervals, calibration, verdicts.

    For queries as driven, the doubts about the numbers and each kind of novelty have rows too.
    """
    columns = case_columns(case)
    for protocol in PROTOCOLS:
        numbers = _numbers(evaluation, protocol)
        if not case.change:
            numbers |= evaluation.doubts(protocol)
        yield from number_rows(columns, protocol, numbers)
        if not case.change:
            yield from _novelty_rows(columns, evaluation, protocol)
    ece_raw, ece = evaluation.calibration
    yield from number_rows(columns, "cells", {"ece_raw": ece_raw, "ece": ece})
    yield from number_rows(columns, "distance", evaluation.acceptance_counts)
    if evaluation.verdicts:
        verdicts = {f"{verdict}_99": count for verdict, count in evaluation.verdicts.items()}
        yield from number_rows(columns, "distance", verdicts | {"pose_ece": evaluation.pose_ece})


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
        "turned_share": judgement.turned_share(evaluation.turn_deg),
        "answered": judgement.answered,
        "kept_precision": evaluation.kept_precision[0],
        "wanted_precision": evaluation.wanted_precision,
    }
    is_level = evaluation.right_within == WITHIN[LEVEL_POSES]
    for name, value_and_bounds in zip(NUMBERS, judgement.numbers, strict=True):
        if name in POSES and not evaluation.has_poses:
            continue
        if name == LEVEL_POSES and not is_level:
            continue
        numbers[name] = value_and_bounds
    return numbers


def _novelty_rows(columns: Mapping[str, Any], evaluation: Evaluation, protocol: str) -> TableRows:
    """Rows of how well each kind of novelty rejects."""
    rejection = evaluation.protocol(protocol).rejection
    for kind, measures, kept_precision in zip(
        evaluation.kinds, rejection, evaluation.kept_precision, strict=True
    ):
        numbers = dict(zip(MEASURES, measures, strict=True)) | {"kept_precision": kept_precision}
        novelty_columns = {**columns, "case": f"novelty {kind}", "kind": kind}
        yield from number_rows(novelty_columns, protocol, numbers)


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


def table(rows: Iterable[Mapping[str, Any]], **common: Any) -> pd.DataFrame:
    """A frame of rows with all columns, each of its type; `common` values stand in each row."""
    defaults = dict.fromkeys(TEXT_COLUMNS, "") | {
        "simulated": False,
        "seed": 0,
        "days": np.nan,
        "level": 0.0,
        "shadow": False,
        "repeat": 0,
    }
    frame = pd.DataFrame(
        [defaults | common | dict(columns) for columns in rows], columns=[*COLUMNS, *CASE_COLUMNS]
    )
    return frame.astype(COLUMN_TYPES)
