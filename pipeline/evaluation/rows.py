"""The table of results: its columns, and the rows that one evaluation gives.

A row is one number: of which model, on which sequence, in which case of its queries, by which
protocol, with its value and interval. Reports, figures and MLflow select from these rows.
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
"""Rows as they come: columns to values, those that are the same in all rows left out."""
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
"""What `yearloc results --csv` prints.

`case` is empty for queries as they were driven, `variant` for a method's own recipe, `sequence` for
a number of all test sequences together; low and high bound a 95 % interval, where there is one.
"""
CASE_COLUMNS = ("change", "level", "shadow", "repeat", "kind", "stress")
"""The parts of a case, so that nobody takes its text apart: an alteration (or `change shown`,
`change to come`, of real changes within `level` metres), its level, whether walls hide what is
behind them, the repeat; the `kind` of novelty, or the method that is compared with; and what is
hard about a sequence of stress."""
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
"""Of every column."""


def case_text(case: Case) -> str:
    """A case in a word or two: `turned 0`, `demolition 60°`, `construction 2 walls, shadow`.

    Empty as driven.
    """
    level = {"demolition": f" {case.level:g}°", "construction": f" {case.level:g} walls"}.get(
        case.change, ""
    )
    repeat = f" {case.repeat}" if case.change and not level else ""
    return f"{case.change}{level}{repeat}{', shadow' if case.shadow else ''}"


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
    """Rows of one case of an evaluation: counts, numbers with intervals, novelties, calibration."""
    columns = case_columns(case)
    for protocol in PROTOCOLS:
        judgement = evaluation.protocol(protocol)
        counts = {
            "queries": len(judgement.seen),
            "seen": judgement.seen.sum(),
            "unseen": judgement.unseen.sum(),
        }
        acceptance = {
            "threshold": evaluation.reject_from[0],
            "turned_share": judgement.turned_share(evaluation.turn_deg),
            "answered": judgement.answered,
            "kept_precision": evaluation.kept_precision[0],
            "wanted_precision": evaluation.wanted_precision,
        }
        numbers = {
            name: values
            for name, values in zip(NUMBERS, judgement.numbers, strict=True)
            if name not in POSES or evaluation.has_poses
            if name != LEVEL_POSES or evaluation.right_within == WITHIN[LEVEL_POSES]
        }
        doubts = {} if case.change else evaluation.doubts(protocol)
        yield from number_rows(columns, protocol, counts | acceptance | numbers | doubts)
        if case.change:
            continue
        for kind, measures, kept_precision in zip(
            evaluation.kinds, judgement.rejection, evaluation.kept_precision, strict=True
        ):
            novelty_columns = columns | {"case": f"novelty {kind}", "kind": kind}
            yield from number_rows(
                novelty_columns,
                protocol,
                dict(zip(MEASURES, measures, strict=True)) | {"kept_precision": kept_precision},
            )
    yield from number_rows(
        columns, "cells", dict(zip(("ece_raw", "ece"), evaluation.calibration, strict=True))
    )
    yield from number_rows(columns, "distance", evaluation.acceptance_counts)
    if evaluation.verdicts:
        verdicts = {f"{verdict}_99": count for verdict, count in evaluation.verdicts.items()}
        yield from number_rows(columns, "distance", verdicts | {"pose_ece": evaluation.pose_ece})


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
    """One row for each number, a value or a value with its bounds, with these columns."""
    for number, values in numbers.items():
        yield {**columns, **row(number, protocol, *np.atleast_1d(values))}


def table(rows: Iterable[Mapping[str, Any]], **common: Any) -> pd.DataFrame:
    """A frame of rows with all columns, each of its type; `common` values stand in every row."""
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
