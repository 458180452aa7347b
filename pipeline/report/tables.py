"""The tables of the report, each a pivot of the table of results.

In: scores, strategies, a comparison, or rows of a study. Out: `Table`s. Most are made by `pivot`:
what has a row, which columns there are, and what stands in a cell. Captions are in words.yaml.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from textwrap import shorten
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd

from pipeline.evaluation.bootstrap import NONE, Estimate
from pipeline.evaluation.caveats import DEGENERATE
from pipeline.evaluation.evaluations import VERDICTS
from pipeline.evaluation.numbers import LEVEL_POSES, MEASURES, average
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import (
    HEADING,
    NEAR_CHANGE,
    NOVELTY,
    PERTURBED,
    UNPERTURBED,
    VIEWPOINT,
    indexed,
    pick,
)
from pipeline.evaluation.steadiness import AWC_FT
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, PERCENTILE, SHOWN
from pipeline.evaluation.viewpoint_matches import NUMBERS as VIEWPOINT_NUMBERS
from pipeline.report.comparison import (
    AUC,
    AUC_BY_DISTANCE,
    AUC_SHARE,
    AUROC,
    AUROC_BY_DISTANCE,
    HEADING_ERROR,
    RECALL,
    RECALL_BY_DISTANCE,
    UNPERTURBED_KIND,
    WITHIN,
    Comparison,
    Kind,
    Measure,
)
from pipeline.report.result import TITLES, Scores, by_model, by_sequence, dates, day, is_posed
from pipeline.report.strategies import SELF_TRAINING, Strategy
from pipeline.report.study import StudyResults, against
from pipeline.report.table import (
    MISSING,
    Cell,
    Table,
    count,
    difference,
    number,
    spread,
    table,
    validation_precision,
)
from pipeline.studies import catalogue

Item = TypeVar("Item")
Of = TypeVar("Of")
DISTANCE_FIRST = PROTOCOLS[::-1]  # the order in which reports show the protocols


class Column(NamedTuple):
    """A column of numbers."""

    heading: str
    number: str  # its name in the table of results
    digits: int = 3  # after the point


# The numbers that a study is about: beside each stands that of the oracle, which answers every
# query with its nearest training pose. The paired test of the second number decides the marks + and
# −. It has only the exact area, which differs little from the AUC of the SCI paper (Kim, Park and
# Kim, RA-L 2019).
MAIN_NUMBERS = {
    "recall_at_1": (Column("oracle", "oracle"), "recall_at_1"),
    "auc_top1": (Column("oracle, exact", "oracle_auc_exact_top1"), "auc_exact_top1"),
}
AWC_FT_BESIDE = "auc_top1"  # the main number in whose table AwC-FT stands
# Of the last test day in `scorecard`: how many queries are answered, and rightly.
ANSWERED = (Column("answers", "answered"), Column("right of those", "precision_at_threshold"))
# What the verdict accepted, and what it got wrong.
ACCEPTED_COLUMNS = (
    Column("accepted", "accepted", 0),
    Column("wrong", "accepted_wrong", 0),
    Column("wrong refused", "refused_wrong", 0),
)
# Errors of the headings that a model gives.
HEADINGS = (
    Column("heading error [°]", "median_heading_error_deg", 1),
    Column("within 10°", "heading_within_10deg"),
)
# The numbers that no main table shows.
FURTHER = (
    Column("AUC exact", "auc_exact_top1"),
    Column("AUC top-5", "auc_top5"),
    Column("AUC top-25", "auc_top25"),
    Column("F1max", "f1_max"),
    Column("R@99%P", "recall_at_99_precision"),
    Column("AUROC", "auroc"),
    Column("precision", "precision_at_threshold"),
    Column("keeps", "validation_precision"),
    Column("recall", "recall_at_threshold"),
    Column("error [m]", "median_error_m", 1),
)
EVERYTHING = (
    Column("recall@1", "recall_at_1"),
    Column("oracle", "oracle"),
    Column("AUC top-1", "auc_top1"),
    *FURTHER,
)
# The precision that accepted poses keep: .99, or the largest below it that can be kept.
KEPT = Column("at", "kept_precision")
# How near the poses are.
POSES = (
    Column("within 2 m, 5°", "within_2m_5deg"),
    Column("within 1 m, 10°", LEVEL_POSES),
    Column("training's heading", "within_2m_5deg_same_heading"),
    Column("turned", "within_2m_5deg_turned"),
    Column("2 m or more beside", "within_2m_5deg_beside"),
    Column("within .5 m, 2°", "within_05m_2deg"),
    Column("error [m]", "error_m", 2),
    Column("error [°]", "error_deg", 2),
    Column("all poses, RMS [m]", "trajectory_m", 2),
    Column("wrong of accepted", "wrong_of_accepted_99", 4),
    Column("accepted and right", "recall_99"),
    KEPT,
)
# How many queries got each verdict.
ANSWERS = (
    *(Column(verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS),
    KEPT,
    Column("calibration error", "pose_ece"),
    Column("in the 50 % ellipsoid", "in_ellipsoid_50"),
    Column("in the 90 % ellipsoid", "in_ellipsoid_90"),
    Column("in the 95 % ellipsoid", "in_ellipsoid_95"),
)
# Training, the model's size, and the parts of a query's time.
COSTS = (
    Column("CPU [s] to train", "train_cpu_s", 1),
    Column("wall [s]", "train_wall_s", 1),
    Column("peak memory [MB]", "train_peak_memory_mb", 0),
    Column("model [MB]", "model_mb", 1),
    Column("view [ms]", "generation_ms", 2),
    Column("ranking [ms]", "retrieval_ms", 2),
    Column("query [ms]", "query_ms", 2),
    Column("query, 95 % [ms]", "query_ms_p95", 2),
)
# Of `novelties`: MEASURES, the validation precision, and the sequence of the worst AUROC.
REJECTION = ("AUROC", "AUC exact", "R@99%P", "precision", "recall", "keeps", "worst AUROC")
# Of Table II of the SCI paper, as `sequences` counts them.
SEQUENCES = ("days", "queries", "distance: seen", "unseen", "not judged")
SEQUENCES_BY_CELLS = ("cells: seen", "unseen", "share unseen")
# After the last step of learning further days, by each protocol.
LEARNING = {
    "recall_of_all": "of all",
    "mean_recall": "mean",
    "forgetting": "forgetting",
    "transfer": "transfer",
}
PSEUDO_LABELLED = {
    "queried": "scans queried",
    "pseudo_labelled": "pseudo-labelled",
    "wrong": "of these wrong",
    "changed": "submaps changed",
}
# The metrics of Yin et al., "Stabilize an Unsupervised Feature Learning for LiDAR-based Place
# Recognition" (IROS 2018): paper 2.
VIEWPOINTS = dict(zip(VIEWPOINT_NUMBERS, ("ROC-AUC", "PR-AUC", "accuracy", "recall"), strict=True))
MOST_PERTURBED_KINDS = 4  # of perturbed queries that have a column in `perturbed`
# The columns of the two tables `every_case`, by cells and by distance, and of `stress`.
BY_CELLS = (AUC, AUC_SHARE, RECALL, AUROC)
BY_DISTANCE = (AUC_BY_DISTANCE, RECALL_BY_DISTANCE, AUROC_BY_DISTANCE, HEADING_ERROR, WITHIN)
STRESS = (RECALL, AUC, AUROC, RECALL_BY_DISTANCE, AUROC_BY_DISTANCE)


def pivot(
    kind: str,
    texts: Sequence[str],
    rows: Iterable[tuple[Sequence[Cell | str], Item]],
    columns: Iterable[tuple[str, Of]],
    cell: Callable[[Item, Of], Cell | str],
    /,
    **options: Any,
) -> Table:
    """A table with a row for each of `rows` and, after the columns of text, one for each `columns`.

    A row is its texts and its item, a column is its heading and its key; `cell` makes the cell of
    an item and a key. `options` are those of `table`.
    """
    columns = list(columns)
    header = (*texts, *(heading for heading, _ in columns))
    cells = [(*names, *(cell(item, of) for _, of in columns)) for names, item in rows]
    return table(kind, header, cells, len(texts), **options)


def titled(columns: Sequence[Column]) -> list[tuple[str, Column]]:
    """The columns with their headings."""
    return [(column.heading, column) for column in columns]


def bounded(values: Estimate, digits: int, mark: str = "") -> Cell:
    """A cell of a value with its interval, from (value, lowest, highest)."""
    value, *interval = values
    return number(value, digits, interval, mark)


def _plain(protocol: str) -> Callable[[Scores, Column], Cell]:
    """Makes cells of numbers without intervals."""
    return lambda score, column: number(score.number(protocol, column.number), column.digits)


def _bounded(score: Scores, column: tuple[str, Column]) -> Cell:
    protocol, (_, name, digits) = column
    return bounded(score.values(protocol, name), digits)


def _numbers(scores: Iterable[Scores], column: tuple[str, Column]) -> list[float]:
    protocol, (_, name, _) = column
    return [score.number(protocol, name) for score in scores]


def scorecard(scores: Sequence[Scores]) -> Table:
    """Recall@1 by distance: one row per model, one column per test day, and more of the last day.

    The last columns are the share answered, the share of these answers that is right, the
    validation precision of the threshold, and the time of a query where any was measured.
    """
    recall = over_days("scorecard", scores, "distance", "recall_at_1", shows_degenerate=True)
    is_timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    rows = []
    for recall_cells, group in zip(recall.rows, by_model(scores).values(), strict=True):
        last = group[-1]
        answered = [_plain("distance")(last, column) for column in ANSWERED]
        row = [
            *recall_cells,
            *answered,
            validation_precision(last.validation_precision, last.target_precision),
        ]
        rows.append([*row, number(last.number("", "query_ms"), 1)] if is_timed else row)
    header = [*recall.header, *(column.heading for column in ANSWERED), "keeps"]
    header += ["ms a query"] * is_timed
    return table("scorecard", header, rows, last_day=recall.header[-1])


def over_days(
    kind: str, scores: Sequence[Scores], protocol: str, name: str, *, shows_degenerate: bool = False
) -> Table:
    """One number by one protocol: one row per model, one column per test day, with intervals.

    Each cell says which result it is of, so that the page's map can show it. If `shows_degenerate`,
    a cell says "degenerate" where the numbers of that day mean nothing.
    """

    def cell(group: Sequence[Scores], i: int) -> Cell:
        score = group[i]
        is_degenerate = shows_degenerate and score.degenerate(protocol)
        shown = Cell(DEGENERATE) if is_degenerate else bounded(score.values(protocol, name), 3)
        return replace(shown, result=(score.model, score.sequence))

    columns = [(date, i) for i, date in enumerate(dates(scores).values())]
    rows = [((model,), group) for model, group in by_model(scores).items()]
    return pivot(kind, ("method",), rows, columns, cell)


def accepted(scores: Sequence[Scores]) -> Table:
    """How many answers of a model were accepted on each day, and what the verdict got wrong."""
    days = dates(scores)
    rows = [
        ((Cell(days[score.sequence], result=(score.model, score.sequence)),), score)
        for score in scores
    ]
    return pivot("accepted", ("day",), rows, titled(ACCEPTED_COLUMNS), _plain("distance"))


def main_number(study: StudyResults, protocol: str, name: str) -> Table:
    """One of MAIN_NUMBERS: one row per model, one column per test day, the oracle last.

    Cells have 95 % intervals, and a mark where the paired test against the study's first method is
    clear. A mean over several days follows, and beside AWC_FT_BESIDE the AwC-FT, which the oracle
    has not.
    """
    oracle, tested = MAIN_NUMBERS[name]
    days = dates(study.results)
    marks, references = _marks(study, protocol, tested)
    groups = by_model(study.results)
    rows: list[list[Cell | str]] = []
    for model in study.ranked:
        row: list[Cell | str] = [model]
        for result in groups[model]:
            mark = marks.get((model, result.sequence), "")
            cell = bounded(result.values(protocol, name), 3, mark)
            row.append(Cell(DEGENERATE) if result.degenerate(protocol) else cell)
        rows.append(row)
    first_of_day = [group[0] for group in by_sequence(study.results).values()]
    oracle_shares = [result.number(protocol, oracle.number) for result in first_of_day]
    rows.append([oracle.heading, *(number(share, 3) for share in oracle_shares)])
    header = [TITLES[name], *days.values()]
    if len(days) > 1:
        header.append("mean")
        shares = [[r.number(protocol, name) for r in groups[model]] for model in study.ranked]
        for row, shares_of_days in zip(rows, [*shares, oracle_shares], strict=True):
            row.append(spread(shares_of_days, 3))
    areas = indexed(pick(study.unperturbed, number=AWC_FT, protocol=protocol), "model")
    has_areas = name == AWC_FT_BESIDE and any(np.isfinite(area.value) for area in areas.values())
    if has_areas:
        header.append(TITLES[AWC_FT])
        for row, model in zip(rows, [*study.ranked, ""], strict=True):
            row.append(number(areas.get(model, NONE)[0], 3))
    caption: Any = {
        "protocol": protocol,
        "references": references,
        "marked": bool(marks),
        "has_areas": has_areas,
    }
    return table(f"main_{name}", header, rows, has_footer=True, **caption)


def _marks(
    study: StudyResults, protocol: str, name: str
) -> tuple[dict[tuple[str, str], str], dict[str, bool]]:
    """Map model and sequence to `+` or `−` where the paired test of a number is clear.

    Returns also the references, with whether models with poses are compared with one without.
    """
    rows = against(study.rows, protocol)
    references: dict[str, bool] = {}
    for model, reference in rows[["model", "of"]].drop_duplicates().itertuples(index=False):
        unlike = is_posed(model) and not is_posed(reference)
        references[reference] = references.get(reference, False) or unlike
    differences = indexed(pick(rows, number=f"{name}_difference"), "model", "sequence")
    p_values = indexed(pick(rows, number=f"{name}_difference_p"), "model", "sequence")
    marks = {
        key: "+" if value > 0 else "−"
        for key, (value, *_) in differences.items()
        if p_values[key][0] < LEVEL
    }
    return marks, references


def pose_tables(scores: Sequence[Scores]) -> list[Table]:
    """The verdicts on the queries of each day, and how good the poses are."""
    headings = ("model", "sequence")
    return [
        pose_table("pose_answers", headings, scores, ANSWERS),
        pose_table("poses", headings, scores, POSES),
    ]


def pose_table(
    kind: str, texts: tuple[str, str], scores: Sequence[Scores], columns: Sequence[Column]
) -> Table:
    """Some numbers of each model and test day by distance, with 95 % intervals.

    `texts` stand above the model and the day. The column of level sweeps is left out where there
    are none.
    """
    days = dates(scores)
    has_level = any(("distance", LEVEL_POSES) in score.numbers for score in scores)
    shown = [
        (column.heading, ("distance", column))
        for column in columns
        if has_level or column.number != LEVEL_POSES
    ]
    rows = [((score.model, days[score.sequence]), score) for score in scores]
    return pivot(kind, texts, rows, shown, _bounded)


def means(study: StudyResults) -> Table:
    """The other numbers of each model by both protocols: means over the test sequences."""
    models = by_model(study.results).items()
    return pivot(
        "means",
        ("mean", "by"),
        [((model, by), (by, group)) for by in DISTANCE_FIRST for model, group in models],
        titled((*FURTHER, *HEADINGS)),
        lambda row, column: number(average(_numbers(row[1], (row[0], column))), column.digits),
    )


def everything(study: StudyResults, protocol: str) -> Table:
    """All numbers of each sequence and model by one protocol."""
    rows = [
        ((name, result.model), result)
        for name, group in by_sequence(study.results).items()
        for result in group
    ]
    texts = ("sequence", "model")
    columns = titled(EVERYTHING)
    return pivot("everything", texts, rows, columns, _plain(protocol), protocol=protocol)


def headings(study: StudyResults) -> Table | None:
    """Errors of the headings by both protocols; None if no model gives a heading.

    There is one row per model and sequence, and one of a model's mean over several.
    """

    def cell(group: Sequence[Scores], column: tuple[str, Column]) -> Cell:
        _, (_, _, digits) = column
        is_one = len(group) == 1
        return _bounded(group[0], column) if is_one else spread(_numbers(group, column), digits)

    rows: list[tuple[Sequence[str], Sequence[Scores]]] = []
    for model, group in by_model(study.results).items():
        if any(np.isfinite(result.evaluation.heading_error_deg).any() for result in group):
            rows += [((model, result.sequence), [result]) for result in group]
            rows += [((model, "mean"), group)] if len(group) > 1 else []
    columns = [
        (f"{column.heading}, by {by}", (by, column))
        for by, column in product(DISTANCE_FIRST, HEADINGS)
    ]
    return pivot("headings", ("model", "sequence"), rows, columns, cell) if rows else None


def novelties(study: StudyResults, protocol: str) -> Table:
    """Measures of each kind of novelty by one protocol: means, and the sequence of worst AUROC."""
    rows = []
    novelty_rows = pick(study.rows, ask=NOVELTY, protocol=protocol, seed=0)
    for model, group in by_model(study.results).items():
        sequences = [result.sequence for result in group]
        for i, kind in enumerate(group[0].evaluation.kinds):
            values = pick(novelty_rows, model=model, of=kind).pivot(
                index="sequence", columns="number", values="value"
            )
            values = values.loc[sequences]
            kept = validation_precision(
                values["validation_precision"].iloc[0], group[0].target_precision
            )
            auroc = values["auroc"].fillna(np.inf)
            worst = number(values["auroc"][auroc.idxmin()], 3)
            is_known = worst.key is not None
            rows.append(
                (
                    model,
                    f"{kind}, in use" if i == 0 else kind,
                    *(number(average(values[name]), 3) for name in MEASURES),
                    kept,
                    replace(worst, small=f"on {day(str(auroc.idxmin()))}" if is_known else ""),
                )
            )
    header = ("model", "novelty", *REJECTION)
    return table("novelties", header, rows, text_columns=2, protocol=protocol)


def paired(study: StudyResults, protocol: str) -> list[Table]:
    """Every model against a reference: differences with intervals, p, and who alone was right.

    Models with poses have a table of their own if their reference has poses too.
    """
    tested = against(study.rows, protocol)
    return [
        _paired(group, protocol, str(reference))
        for reference, group in tested.groupby("of", sort=False)
    ]


def _paired(tested: pd.DataFrame, protocol: str, reference: str) -> Table:
    rows = []
    for (model, sequence), group in tested.groupby(["model", "sequence"], sort=False):
        values = indexed(group, "number")
        row: list[Cell | str] = [model, sequence]
        for name in COMPARED:
            change, *interval = values[f"{name}_difference"]
            p, *_ = values[f"{name}_difference_p"]
            verdict = "better" if change > 0 else "worse"
            row += [difference(change, 3, interval), number(p, 3)]
            row.append(verdict if p < LEVEL else "undecided")
        rows.append(
            [*row, *(count(values[f"only_{who}_right"][0]) for who in ("this", "reference"))]
        )
    header = ["model", "sequence"]
    for name in COMPARED:
        header += [f"Δ {TITLES[name]}", "p", "verdict"]
    header += ["only it right", f"only {reference} right"]
    unlike = any(map(is_posed, tested["model"])) and not is_posed(reference)
    caption: Any = {"protocol": protocol, "reference": reference, "unlike": unlike}
    return table("paired", header, rows, text_columns=2, **caption)


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line fitted to one number over the days: one row per model, and one for the oracle."""
    lines = pick(rows, protocol=protocol)
    digits = 1 if name == PERCENTILE else 3
    per = f"per_{PER_DAYS}_days"
    table_rows = []
    for model in pick(lines, number=f"{name}_line")["method"].unique():
        fitted = indexed(pick(lines, method=model), "number")
        slope, *interval = fitted.get(f"{name}_{per}", NONE)
        retrain_after, *retrain_interval = fitted.get(f"{name}_retrain_after_days", NONE)
        if model == ORACLE:  # it is not trained
            retrain_after = np.nan
        table_rows.append(
            (
                model,
                number(fitted.get(f"{name}_day_0", NONE)[0], digits),
                difference(slope, digits, interval),
                difference(fitted.get(f"{name}_theil_sen_{per}", NONE)[0], digits),
                number(fitted.get(f"{name}_slope_p", NONE)[0], 3),
                number(retrain_after, 0, retrain_interval),
            )
        )
    columns = ("on day 0", f"per {PER_DAYS} days", "Theil–Sen", "p", "train again after [days]")
    return table("ageing", ("model", *columns), table_rows, title=title, per=PER_DAYS)


def setup(study: StudyResults, longest: int = 400) -> Table:
    """One row per model: what it is, its view, its share of full training, and its size.

    The description of what it is is cut to `longest` characters.
    """
    rows = []
    # The models of the first seed. A model that only adds poses to another's answers is not trained
    # itself, so it is left out.
    for model in study.families:
        if model not in study.trained:
            continue
        record = study.models[model]
        what = catalogue.description_of(record.recipe.get("_target_", ""))
        budget = MISSING
        training = "nothing"
        if record.rounds:
            budget = record.recipe.get("budget", MISSING)
            training = f"{record.rounds} rounds"
            if record.best_round is not None:
                training += f", no. {record.best_round + 1} kept"
        rows.append(
            (
                model,
                shorten(what, longest, placeholder=" …") or MISSING,
                record.recipe.get("view", MISSING),
                budget,
                training,
                number(record.megabytes, 1),
            )
        )
    header = ("model", "what it is", "looks at", "budget", "trained", "model [MB]")
    return table("setup", header, rows, text_columns=5)


def sequences(study: StudyResults) -> Table:
    """Table II of the SCI paper: each test sequence's age and how many of its queries are seen.

    A query is seen if training had been at its place. It is judged once by distance and once by
    grid cells; by distance some queries are neither seen nor unseen.
    """
    rows = []
    for name, (result, *_) in by_sequence(study.results).items():
        queries = result.number("cells", "queries")
        seen, unseen = (result.number("distance", sight) for sight in ("seen", "unseen"))
        seen_by_cells, unseen_by_cells = (
            result.number("cells", sight) for sight in ("seen", "unseen")
        )
        counts = (result.days, queries, seen, unseen, queries - seen - unseen)
        share = number(unseen_by_cells / queries if queries else np.nan, 3)
        cells = map(count, (*counts, seen_by_cells, unseen_by_cells))
        rows.append((name, *cells, share))
    return table("sequences", ("sequence", *SEQUENCES, *SEQUENCES_BY_CELLS), rows)


def costs(study: StudyResults) -> Table | None:
    """One row per model, variants and seeds too: what training cost here, and a query's time.

    None if nothing was measured.
    """
    rows = [
        ((model.name,), indexed(pick(study.rows, **model.columns), "number"))
        for model in study.settings.models
    ]
    measured = {column.number for column in COSTS}
    if not any(np.isfinite(row.get(name, NONE)[0]) for _, row in rows for name in measured):
        return None
    return pivot(
        "costs",
        ("model",),
        rows,
        titled(COSTS),
        lambda row, column: number(row.get(column.number, NONE)[0], column.digits),
    )


def of_order(order: str, strategies: Sequence[Strategy]) -> list[Table]:
    """All tables of one order of learning further days."""
    tables = [learning(order, strategies)]
    if order == SELF_TRAINING:
        tables += [
            pseudo_labelled(strategies),
            *(query_days(strategies, by) for by in DISTANCE_FIRST),
        ]
    return tables


def learning(order: str, strategies: Sequence[Strategy]) -> Table:
    """Recall and forgetting after the last step by both protocols, places, and costs of a step."""
    columns = list(product(DISTANCE_FIRST, LEARNING))  # protocol and number of each
    rows = []
    for strategy in strategies:
        places = strategy.over("places")[0]  # (step,) of the first seed
        # step 0 is the first training, whose cost is another table's
        cpu_s = [average(of_seed[1:]) for of_seed in strategy.over("cpu_s")]
        rows.append(
            (
                strategy.model,
                strategy.name,
                *(spread(strategy.last(name, protocol), 3) for protocol, name in columns),
                Cell(f"{places[0]:.0f} → {places[-1]:.0f}", float(places[-1])),
                spread(strategy.last("bytes") / 1e6, 1),
                spread(cpu_s, 1),
            )
        )
    titles = [
        f"{protocol}: {LEARNING[name]}" if name == "recall_of_all" else LEARNING[name]
        for protocol, name in columns
    ]
    header = ("model", "strategy", *titles, "places", "model [MB]", "CPU [s] a step")
    return table("lifelong", header, rows, text_columns=2, order=order)


def pseudo_labelled(strategies: Sequence[Strategy]) -> Table:
    """The numbers of pseudo-labelled scans and of changed submaps over all steps."""
    return pivot(
        "lifelong_pseudo_labelled",
        ("model", "strategy"),
        [((strategy.model, strategy.name), strategy) for strategy in strategies],
        [(heading, name) for name, heading in PSEUDO_LABELLED.items()],
        lambda strategy, name: spread(strategy.total(name), 0),
    )


def query_days(strategies: Sequence[Strategy], protocol: str) -> Table:
    """Recall on each queried day before the first step and after the last."""
    rows = [
        ((strategy.model, strategy.name, when), (strategy, step))
        for strategy in strategies
        for when, step in (("before", 0), ("after", -1))
    ]
    days = dict.fromkeys(name for strategy in strategies for name in strategy.groups)
    return pivot(
        "lifelong_queried",
        ("model", "strategy", "when"),
        rows,
        [(name, name) for name in days],
        lambda row, name: spread(row[0].over("recall_at_1", protocol, name)[:, row[1]], 3),
        protocol=protocol,
    )


def over_headings(study: StudyResults) -> list[Table]:
    """Paper 2's metrics, one row per sequence and model: means over headings, and over seeds.

    A table without rows is left out.
    """
    totals = indexed(pick(study.rows, ask=VIEWPOINT, of=""), "sequence", "model", "number")
    heading_rows = []
    seed_rows = []
    for key, numbers in _by_heading(study).items():
        at_headings = numbers.groupby("at").mean()
        with_auc = int(np.isfinite(at_headings["roc_auc"]).sum())
        heading_rows.append(
            (
                *key,
                *(spread(at_headings[name], 3) for name in VIEWPOINTS),
                f"{with_auc} of {len(at_headings)}",
                *(count(totals[*key, name][0]) for name in ("queries", "bytes_per_place")),
            )
        )
        of_seeds = numbers.groupby("seed").mean()
        if len(of_seeds) > 1:
            seed_means = (spread(of_seeds[name], 3) for name in VIEWPOINTS)
            seed_rows.append((*key, *seed_means, count(len(of_seeds))))
    header = ("sequence", "model", *VIEWPOINTS.values())
    totals_header = ("headings with ROC-AUC", "queries", "bytes a place")
    candidates = (
        table("viewpoints_over_headings", (*header, *totals_header), heading_rows, 2),
        table("viewpoints_over_seeds", (*header, "seeds"), seed_rows, 2),
    )
    return [candidate for candidate in candidates if candidate.rows]


def every_heading(study: StudyResults, name: str) -> Table:
    """One of paper 2's metrics: one column per heading, means over the seeds."""
    rows = [(key, numbers.groupby("at")[name]) for key, numbers in _by_heading(study).items()]
    headings_deg = sorted({deg for _, groups in rows for deg in groups.groups})
    return pivot(
        "every_heading",
        ("sequence", "model"),
        rows,
        [(f"{deg:g}°", deg) for deg in headings_deg],
        lambda groups, deg: spread(groups.get_group(deg), 3),
        title=VIEWPOINTS[name],
    )


def _by_heading(study: StudyResults) -> dict[tuple[str, str], pd.DataFrame]:
    """For each sequence and model its numbers, one row per seed and heading `at`."""
    groups = pick(study.rows, ask=VIEWPOINT, of=HEADING).groupby(["sequence", "model"], sort=False)
    return {
        key: group.pivot(index=["seed", "at"], columns="number", values="value")
        for key, group in groups
    }


def perturbed(study: StudyResults, models: Iterable[str]) -> Table | None:
    """Recall@1 by distance on perturbed queries, beside unperturbed queries on the same days.

    One row per model that got perturbed queries; the last column is the change with age. None if no
    queries were perturbed.
    """
    rows = pick(study.rows[study.rows["ask"].isin([UNPERTURBED, PERTURBED])], seed=0)
    days = pick(rows, ask=PERTURBED)["sequence"].unique()
    if not len(days):
        return None
    comparison = Comparison(rows[rows["sequence"].isin(days)], {})
    kinds = comparison.kinds[: 1 + MOST_PERTURBED_KINDS]  # unperturbed queries come first
    slopes = indexed(pick(study.unperturbed, number=f"recall_at_1_per_{PER_DAYS}_days"), "model")
    table_rows = []
    for model in models:
        if model not in comparison.models:
            continue
        recalls = [comparison.measurement(model, kind, RECALL_BY_DISTANCE).mean for kind in kinds]
        if np.isfinite(recalls[1:]).any():
            slope, *interval = slopes.get(model, NONE)
            recall_cells = [number(recall, 3) for recall in recalls]
            table_rows.append((model, *recall_cells, difference(slope, 3, interval)))
    day_names = ", ".join(dates(study.results).get(name, name) for name in days)
    header = ("method", *(kind.label for kind in kinds), f"{PER_DAYS} days older")
    return table("perturbed", header, table_rows, days=day_names) if table_rows else None


def every_case(comparison: Comparison, measures: Sequence[Measure]) -> Table:
    """One row per model and kind of queries: means ± standard deviation over the sequences.

    The first measure also has its standard deviations over repeats and over seeds.
    """
    first, *others = measures
    rows = []
    for model, kind in product(comparison.ordered(comparison.kinds[-1], first), comparison.kinds):
        measurement = comparison.measurement(model, kind, first)
        rows.append(
            (
                model,
                kind.label,
                count(comparison.seeds[model]),
                _mean_and_spread(comparison, model, kind, first),
                number(measurement.over_repeats, 3),
                number(measurement.over_seeds, 3),
                *(_mean_and_spread(comparison, model, kind, measure) for measure in others),
            )
        )
    deviations = ("± over repeats", "± over seeds")
    titles = [measure.title for measure in others]
    header = ("model", "queries", "seeds", first.title, *deviations, *titles)
    return table("every_case", header, rows, text_columns=2, protocol=first.protocol)


def over_kinds(comparison: Comparison, measure: Measure) -> Table:
    """One measure: one row per model, one column per kind of queries.

    Entries are means ± standard deviation over the sequences. A measure relative to unperturbed
    queries has no column for these.
    """
    kinds = comparison.changes if measure.relative else comparison.kinds
    return pivot(
        "over_kinds",
        ("model",),
        [((model,), model) for model in comparison.ordered(kinds[-1], measure)],
        [(kind.label, kind) for kind in kinds],
        lambda model, kind: _mean_and_spread(comparison, model, kind, measure),
        title=measure.title,
    )


def _mean_and_spread(comparison: Comparison, model: str, kind: Kind, measure: Measure) -> Cell:
    """The mean of a measure ± its standard deviation over the sequences."""
    return spread(comparison.measurement(model, kind, measure).by_sequence, measure.digits)


def on_sequences(comparison: Comparison, kind: Kind, measure: Measure) -> Table:
    """One measure on one kind of queries: one row per model, one column per sequence.

    Entries are means over the seeds ± standard deviation over the repeats.
    """
    return pivot(
        "on_sequences",
        ("model",),
        [
            ((model,), comparison.measurement(model, kind, measure))
            for model in comparison.ordered(kind, measure)
        ],
        [(sequence, i) for i, sequence in enumerate(comparison.sequences)],
        lambda measurement, i: spread(measurement.on(i).by_repeat, measure.digits),
        title=measure.title,
        kind=kind,
    )


def stress(comparison: Comparison, titles: Mapping[str, str]) -> Table:
    """One row per stress sequence and model: means ± standard deviation over the seeds.

    Queries are unperturbed.
    """
    models = comparison.ordered(UNPERTURBED_KIND, RECALL)
    rows = []
    for (i, sequence), model in product(enumerate(comparison.sequences), models):
        cells = [
            spread(
                comparison.measurement(model, UNPERTURBED_KIND, measure).on(i).by_seed,
                measure.digits,
            )
            for measure in STRESS
        ]
        rows.append((titles[sequence], model, count(comparison.seeds[model]), *cells))
    header = ("sequence", "model", "seeds", *(measure.title for measure in STRESS))
    return table("stress", header, rows, text_columns=2)


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number near real changes: one row per model, one column per band of distance.

    Below them stand the oracle's recall and the numbers of queries, which are the same for every
    model. `bands` maps the farthest distance of a band in metres to its name.
    """
    shown = pick(rows, ask=NEAR_CHANGE, of=SHOWN, protocol=protocol)
    shown = shown[shown["method"] != ""]
    # in these rows `at` is the farthest distance of the band
    values = indexed(shown, "number", "method", "at")
    models = shown["method"].unique()
    items = [((model,), (name, model, 3)) for model in models]
    if name == "recall_at_1":
        items.append((("oracle",), ("oracle", models[0], 3)))
    items += [((f"{sight} queries",), (sight, models[0], 0)) for sight in ("seen", "unseen")]
    return pivot(
        "near_changes",
        ("nearest change",),
        items,
        [(band, edge_m) for edge_m, band in bands.items()],
        lambda row, edge_m: bounded(values[row[0], row[1], edge_m], row[2]),
        title=TITLES[name],
        protocol=protocol,
    )


def over_cell_sizes(
    values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]
) -> Table:
    """One number over cell sizes: one row per model, the best at the largest cells first.

    `values` maps a model to its values (sequence,) at each size; entries are means ± standard
    deviation over the sequences.
    """
    at_largest = {model: average(by_size[-1]) for model, by_size in values.items()}
    order = sorted(values, key=lambda model: -np.nan_to_num(at_largest[model], nan=-np.inf))
    return pivot(
        "cells",
        ("model",),
        [((model,), values[model]) for model in order],
        [(f"{size_m:g} m", i) for i, size_m in enumerate(sizes_m)],
        lambda by_size, i: spread(by_size[i], 3),
        title=title,
    )
