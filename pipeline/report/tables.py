"""The tables of a report.

Every cell is a row of the table of results, or a mean and deviation over some of its rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import shorten
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.judgement import VERDICTS
from pipeline.evaluation.numbers import LEVEL_POSES, MEASURES
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, SHOWN
from pipeline.report.result import Result, Scores, by_model, by_sequence, dates, day, mean
from pipeline.report.selection import NONE, indexed
from pipeline.report.study import Study, against
from pipeline.report.table import (
    MISSING,
    Cell,
    Table,
    average,
    count,
    difference,
    kept,
    number,
    spread,
    table,
)
from pipeline.studies import catalogue
from pipeline.studies.models import ModelName

Columns = Sequence[tuple[str, str, int]]  # heading, number, digits
# what is shown without intervals
SHOWN_MEANS = (
    ("AUC exact", "auc_exact_top1", 3),
    ("AUC top-5", "auc_top5", 3),
    ("AUC top-25", "auc_top25", 3),
    ("F1max", "f1_max", 3),
    ("R@99%P", "recall_at_99_precision", 3),
    ("AUROC", "auroc", 3),
    ("precision", "precision_at_threshold", 3),
    ("keeps", "kept_precision", 3),
    ("recall", "recall_at_threshold", 3),
    ("error [m]", "median_error_m", 1),
    ("heading error [°]", "median_heading_error_deg", 1),
    ("within 10°", "heading_within_10deg", 3),
)
HEADINGS = SHOWN_MEANS[-2:]
MAIN = {
    "recall_at_1": ("recall@1", "oracle", "oracle", "recall_at_1"),
    "auc_top1": ("AUC top-1", "oracle_auc_exact_top1", "oracle, exact", "auc_exact_top1"),
}
"""Number of the models: its heading, the oracle's number beside it and its heading, and the number
of the paired test whose mark stands behind it: the SCI paper's area and the exact one differ
little."""
BOTH = PROTOCOLS[::-1]
"""In the order in which people ask."""
TITLES = {"recall_at_1": "recall@1", "auc_top1": "AUC top-1", "auc_exact_top1": "exact AUC"}
COSTS = (
    ("CPU [s] to train", "train_cpu_s", 1),
    ("wall [s]", "train_wall_s", 1),
    ("peak memory [MB]", "train_peak_memory_mb", 0),
    ("model [MB]", "model_mb", 1),
    ("view [ms]", "generation_ms", 2),
    ("ranking [ms]", "retrieval_ms", 2),
    ("query [ms]", "query_ms", 2),
    ("query, 95 % [ms]", "query_ms_p95", 2),
)


POSES = (
    ("within 2 m, 5°", "within_2m_5deg", 3),
    ("within 1 m, 10°", LEVEL_POSES, 3),
    ("training's heading", "within_2m_5deg_same_heading", 3),
    ("turned", "within_2m_5deg_turned", 3),
    ("2 m or more beside", "within_2m_5deg_beside", 3),
    ("within .5 m, 2°", "within_05m_2deg", 3),
    ("error [m]", "error_m", 2),
    ("error [°]", "error_deg", 2),
    ("all poses, RMS [m]", "trajectory_m", 2),
    ("wrong of accepted at .99", "wrong_of_accepted_99", 4),
    ("recall at .99", "recall_99", 3),
)
BELIEVED = {
    "believed": "accepted",
    "wrong": "accepted_wrong",
    "wrong refused": "refused_wrong",
}
ANSWERS = (
    *((verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS),
    ("calibration error", "pose_ece", 3),
)


def scorecard(scores: Sequence[Scores]) -> Table:
    """Recall@1 by distance: a row a model, a column a test day; then columns for the last day.

    These are: share answered, share of those right, precision promised by held-out blocks, time.
    """
    right = over_days("scorecard", scores, "distance", "recall_at_1")
    timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    rows = []
    for cells, group in zip(right.rows, by_model(scores).values(), strict=True):
        last = group[-1]
        answered, precise = (
            number(last.number("distance", name), 3)
            for name in ("answered", "precision_at_threshold")
        )
        cost = [number(last.number("", "query_ms"), 1)] * timed
        rows.append((*cells, answered, precise, kept(last.kept, last.wanted_precision), *cost))
    heads = ("answers", "right of those", "keeps", *["ms a query"] * timed)
    header = (*right.header, *heads)
    return table("scorecard", header, rows, last=right.header[-1])


def believed(scores: Sequence[Scores]) -> Table:
    """How many answers of a model were believed on each day, and what the verdict got wrong."""
    days = dates(scores)
    rows = [
        (
            replace(Cell(days[score.sequence]), of=(score.model, score.sequence)),
            *(count(score.number("distance", name)) for name in BELIEVED.values()),
        )
        for score in scores
    ]
    return table("believed", ("day", *BELIEVED), rows)


def over_days(kind: str, scores: Sequence[Scores], protocol: str, name: str) -> Table:
    """One number by one protocol: a row a model, a column a test day, with 95 % intervals."""
    rows = []
    for model, group in by_model(scores).items():
        cells = []
        for score in group:
            cell = number(score.number(protocol, name), 3, score.interval(protocol, name))
            void = kind == "scorecard" and score.void(protocol)
            cells.append(replace(Cell(VOID) if void else cell, of=(model, score.sequence)))
        rows.append((model, *cells))
    return table(kind, ("method", *dates(scores).values()), rows)


def a_row_a_result(
    kind: str,
    words: Sequence[str],
    scores: Sequence[Scores],
    names: Mapping[str, str],
    columns: Columns,
    protocol: str = "distance",
    **values: object,
) -> Table:
    """Some numbers of each model and test sequence by one protocol, with 95 % intervals.

    `words` head the columns of the model and of the sequence, whose `names` stand there.
    """
    rows = [
        (
            score.model,
            names[score.sequence],
            *(
                number(score.number(protocol, name), digits, score.interval(protocol, name))
                for _, name, digits in columns
            ),
        )
        for score in scores
    ]
    header = (*words, *(heading for heading, _, _ in columns))
    return table(kind, header, rows, words=2, **values)


def poses(posed: Sequence[Scores]) -> list[Table]:
    """What a robot is told of the queries of each day, and how good the poses are."""
    words = ("model", "sequence")
    return [
        a_row_a_result(kind, words, posed, dates(posed), columns)
        for kind, columns in (("pose_answers", ANSWERS), ("poses", pose_columns(posed, POSES)))
    ]


def pose_columns(posed: Sequence[Scores], columns: Columns) -> Columns:
    """The columns of poses, without that of level sweeps where there are none."""
    has_level = any(("distance", LEVEL_POSES) in score.numbers for score in posed)
    return tuple(column for column in columns if has_level or column[1] != LEVEL_POSES)


def setup(study: Study, longest: int = 400) -> Table:
    """A row a model: what it is, its view, its share of full training, and its size."""
    rows = []
    for model, record in (
        (model, study.models[model]) for model in study.families if model in study.trained
    ):
        recipe = record.recipe
        description = (
            shorten(catalogue.what(recipe.get("_target_", "")), longest, placeholder=" …")
            or MISSING
        )
        best = "" if record.best_round is None else f", no. {record.best_round + 1} kept"
        budget = recipe.get("budget", MISSING)
        rounds_text = f"{record.rounds} rounds{best}"
        training = (budget, rounds_text) if record.rounds else (MISSING, "nothing")
        rows.append(
            (
                model,
                description,
                recipe.get("view", MISSING),
                *training,
                number(record.megabytes, 1),
            )
        )
    return table(
        "setup",
        ("model", "what it is", "looks at", "budget", "trained", "model [MB]"),
        rows,
        words=5,
    )


def sequences(study: Study) -> Table:
    """Table II of the SCI paper: each test sequence's age and how many of its queries are seen.

    Counts are by both protocols.
    """
    rows = []
    for name, (result, *_) in by_sequence(study.results).items():
        queries = result.number("cells", "queries")
        (near, far), (seen, unseen) = (
            [result.number(protocol, key) for key in ("seen", "unseen")] for protocol in BOTH
        )
        counts = [result.days, queries, near, far, queries - near - far, seen, unseen]
        rows.append((name, *map(count, counts), number(unseen / queries if queries else np.nan, 3)))
    distance = ("distance: seen", "unseen", "not judged")
    cells = ("cells: seen", "unseen", "share unseen")
    return table("sequences", ("sequence", "days", "queries", *distance, *cells), rows)


def main(study: Study, protocol: str, name: str) -> Table:
    """One number of MAIN by one protocol: a row a model, a column a test day, the oracle last.

    Cells have 95 % intervals.
    """
    heading, oracle, oracle_heading, paired_number = MAIN[name]
    marks = _marks(study, protocol, paired_number)
    days = dates(study.results)
    models = by_model(study.results)
    several = len(days) > 1

    def entry(result: Result) -> Cell:
        mark = marks.get((result.model, result.sequence), "")
        cell = number(result.number(protocol, name), 3, result.interval(protocol, name), mark)
        return Cell(VOID) if result.void(protocol) else cell

    oracle_values = [
        group[0].number(protocol, oracle) for group in by_sequence(study.results).values()
    ]
    means = {
        model: [spread([result.number(protocol, name) for result in group], 3)] * several
        for model, group in models.items()
    }
    rows = [(model, *map(entry, models[model]), *means[model]) for model in study.ranked]
    oracle_cells = [number(value, 3) for value in oracle_values]
    rows.append((oracle_heading, *oracle_cells, *[spread(oracle_values, 3)] * several))
    context: Any = {"protocol": protocol, "reference": study.families[0], "marked": bool(marks)}
    return replace(
        table(f"main_{name}", (heading, *days.values(), *["mean"] * several), rows, **context),
        foot=True,
    )


def _marks(study: Study, protocol: str, paired_number: str) -> dict[tuple[str, str], str]:
    """Map model and sequence to + or −, where the paired test is clear.

    It tells whether the model is clearly better or worse than the study's first method.
    """
    values = indexed(against(study.rows, protocol), "number", "model", "sequence")
    clear = [
        key
        for (name, *key), (p, *_) in values.items()
        if name == f"{paired_number}_difference_p" and p < LEVEL
    ]
    return {
        (model, day): "+" if values[f"{paired_number}_difference", model, day][0] > 0 else "−"
        for model, day in clear
    }


def means(study: Study) -> Table:
    """The other numbers of each model by both protocols: means over the test sequences."""
    rows = [
        (
            model,
            protocol,
            *(number(mean(group, protocol, key), digits) for _, key, digits in SHOWN_MEANS),
        )
        for protocol in BOTH
        for model, group in by_model(study.results).items()
    ]
    return table("means", ("mean", "by", *(heading for heading, *_ in SHOWN_MEANS)), rows, words=2)


def everything(study: Study, protocol: str) -> Table:
    """All numbers of each sequence and model by one protocol."""
    columns = (
        ("recall@1", "recall_at_1", 3),
        ("oracle", "oracle", 3),
        ("AUC top-1", "auc_top1", 3),
        *SHOWN_MEANS[:-2],
    )
    rows = [
        (
            name,
            result.model,
            *(number(result.number(protocol, key), digits) for _, key, digits in columns),
        )
        for name, group in by_sequence(study.results).items()
        for result in group
    ]
    return table(
        "everything",
        ("sequence", "model", *(heading for heading, *_ in columns)),
        rows,
        words=2,
        protocol=protocol,
    )


def headings(study: Study) -> Table | None:
    """Errors of the headings by both protocols; None where no model gives a heading."""
    rows: list[tuple[Cell | str, ...]] = []
    columns = [
        (f"{heading}, by {protocol}", protocol, key, digits)
        for protocol in BOTH
        for heading, key, digits in HEADINGS
    ]
    for model, group in by_model(study.results).items():
        if not any(np.isfinite(result.evaluation.heading_error_deg).any() for result in group):
            continue
        for result in group:
            cells = [
                number(result.number(protocol, key), digits, result.interval(protocol, key))
                for _, protocol, key, digits in columns
            ]
            rows.append((model, result.sequence, *cells))
        if len(group) > 1:
            mean_cells = [
                spread([result.number(protocol, key) for result in group], digits)
                for _, protocol, key, digits in columns
            ]
            rows.append((model, "mean", *mean_cells))
    return (
        table(
            "headings", ("model", "sequence", *(heading for heading, *_ in columns)), rows, words=2
        )
        if rows
        else None
    )


def novelties(study: Study, protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means, and the sequence of worst AUROC."""
    measure_titles = ("AUROC", "AUC exact", "R@99%P", "precision", "recall", "keeps")
    rows = []
    for model, group in by_model(study.results).items():
        judgements = [result.evaluation.protocol(protocol) for result in group]
        # (sequence, kind, measure)
        values = np.stack([judgement.rejection[:, :, 0] for judgement in judgements])
        for k, kind in enumerate(group[0].evaluation.kinds):
            auroc = values[:, k, MEASURES.index("auroc")]
            worst_at = int(np.nan_to_num(auroc, nan=np.inf).argmin())
            worst = replace(
                number(auroc[worst_at], 3),
                small=f"on {day(group[worst_at].sequence)}" * bool(np.isfinite(auroc[worst_at])),
            )
            cells = [number(average(values[:, k, measure]), 3) for measure in range(len(MEASURES))]
            keeps = kept(group[0].evaluation.kept_precision[k], group[0].wanted_precision)
            rows.append((model, kind + ("" if k else ", in use"), *cells, keeps, worst))
    return table(
        "novelties",
        ("model", "novelty", *measure_titles, "worst AUROC"),
        rows,
        words=2,
        protocol=protocol,
    )


def paired(study: Study, protocol: str) -> Table | None:
    """Every model against the first: differences with intervals, p, and who alone was right.

    None where there is one model.
    """
    rows = []
    reference = study.families[0]
    values = indexed(against(study.rows, protocol), "model", "sequence", "number")
    for model, sequence in dict.fromkeys((model, sequence) for model, sequence, _ in values):
        cells: list[Cell | str] = [model, sequence]
        for name in COMPARED:
            value, *interval = values[model, sequence, f"{name}_difference"]
            p, *_ = values[model, sequence, f"{name}_difference_p"]
            verdict = "undecided" if not p < LEVEL else "better" if value > 0 else "worse"
            cells += [difference(value, 3, (interval[0], interval[1])), number(p, 3), verdict]
        for side in ("this", "reference"):
            cells.append(count(values[model, sequence, f"only_{side}_right"][0]))
        rows.append(cells)
    columns = [text for name in COMPARED for text in (f"Δ {TITLES[name]}", "p", "verdict")]
    header = ("model", "sequence", *columns, "only it right", f"only {reference} right")
    return (
        table("paired", header, rows, words=2, protocol=protocol, reference=reference)
        if rows
        else None
    )


def costs(study: Study) -> Table | None:
    """A row a model, variants and seeds too: what training cost here, and a query's time.

    None where nothing was measured.
    """
    values = indexed(study.rows, "method", "variant", "seed", "number")
    rows = []
    numbers = {
        (ModelName(*names).name, key): value for (*names, key), (value, *_) in values.items()
    }
    for model in study.trained:
        cells = [number(numbers.get((model, key), np.nan), digits) for _, key, digits in COSTS]
        rows.append((model, *cells))
    cost_table = table("costs", ("model", *(heading for heading, *_ in COSTS)), rows)
    return (
        cost_table if any(cell.key is not None for row in cost_table.rows for cell in row) else None
    )


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line through one number over the days: a row a model and the oracle."""
    values = indexed(rows[rows["protocol"] == protocol], "method", "number")
    table_rows = []
    digits = 1 if name == "novelty_percentile" else 3
    ends = (
        "day_0",
        f"per_{PER_DAYS}_days",
        f"theil_sen_per_{PER_DAYS}_days",
        "slope_p",
        "retrain_after_days",
    )
    for model in dict.fromkeys(rows.loc[rows["number"] == f"{name}_line", "method"]):
        first, slope, middle, p, retrain_after = (
            values.get((model, f"{name}_{end}"), NONE) for end in ends
        )
        slopes = difference(slope[0], digits, slope[1:]), difference(middle[0], digits)
        retrain_cell = number(np.nan if model == ORACLE else retrain_after[0], 0, retrain_after[1:])
        table_rows.append((model, number(first[0], digits), *slopes, number(p[0], 3), retrain_cell))
    header = (
        "model",
        "on day 0",
        f"per {PER_DAYS} days",
        "Theil–Sen",
        "p",
        "train again after [days]",
    )
    return table("ageing", header, table_rows, title=title, per=PER_DAYS)


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number by one protocol: a row a model, a column a band of distance, with intervals.

    Below them stand the oracle and the numbers of queries.
    """
    numbers = indexed(
        rows[(rows["change"] == SHOWN) & (rows["protocol"] == protocol)],
        "number",
        "method",
        "level",
    )
    models = list(dict.fromkeys(model for _, model, _ in numbers))
    lines = [(model, name, model, 3) for model in models]
    lines += [("oracle", "oracle", models[0], 3)] if name == "recall_at_1" else []
    lines += [
        (f"{visibility} queries", visibility, models[0], 0) for visibility in ("seen", "unseen")
    ]
    table_rows = []
    for text, key, model, digits in lines:
        values = (numbers[key, model, edge] for edge in bands)
        table_rows.append(
            (text, *(number(value, digits, (low, high)) for value, low, high in values))
        )
    return table(
        "near_changes",
        ("nearest change", *bands.values()),
        table_rows,
        title=TITLES[name],
        protocol=protocol,
    )
