"""The tables of a report, each a selection of the table of results.

A table is made of what was read from the rows of one study: its results on the test days
(`Scores`), a `Comparison` of altered queries, or `Strategy`s of learning further days. Nothing is
measured here: a cell is a number of the table of results with its 95 % interval, or a mean ± a
standard deviation of several. Captions stand in templates/words.yaml, by the kind of the table.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, product
from textwrap import shorten
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pipeline.evaluation import viewpoints
from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.judgement import VERDICTS
from pipeline.evaluation.numbers import LEVEL_POSES, MEASURES
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, PERCENTILE, SHOWN
from pipeline.report import comparison as measures
from pipeline.report.comparison import Comparison, Kind, Measure
from pipeline.report.result import TITLES, Scores, by_model, by_sequence, dates, day, mean
from pipeline.report.selection import NONE, Values, indexed, pick, with_model
from pipeline.report.strategies import UPDATES, Strategy
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


class Column(NamedTuple):
    """A column of numbers."""

    heading: str
    number: str  # its name in the table of results
    digits: int  # after the point


DISTANCE_FIRST = PROTOCOLS[::-1]  # the protocols in the order in which people ask
# The numbers that a study is about. For each: the row of the oracle, which answers every query with
# its nearest training pose, and the number of the paired test that decides its marks. That is the
# exact area, which differs little from the SCI paper's.
MAIN_NUMBERS = {
    "recall_at_1": (Column("oracle", "oracle", 3), "recall_at_1"),
    "auc_top1": (Column("oracle, exact", "oracle_auc_exact_top1", 3), "auc_exact_top1"),
}
HEADINGS = (
    Column("heading error [°]", "median_heading_error_deg", 1),
    Column("within 10°", "heading_within_10deg", 3),
)
FURTHER = (
    Column("AUC exact", "auc_exact_top1", 3),
    Column("AUC top-5", "auc_top5", 3),
    Column("AUC top-25", "auc_top25", 3),
    Column("F1max", "f1_max", 3),
    Column("R@99%P", "recall_at_99_precision", 3),
    Column("AUROC", "auroc", 3),
    Column("precision", "precision_at_threshold", 3),
    Column("keeps", "kept_precision", 3),
    Column("recall", "recall_at_threshold", 3),
    Column("error [m]", "median_error_m", 1),
)
EVERYTHING = (
    Column("recall@1", "recall_at_1", 3),
    Column("oracle", "oracle", 3),
    Column("AUC top-1", "auc_top1", 3),
    *FURTHER,
)
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
ANSWERED = (
    Column("answers", "answered", 3),
    Column("right of those", "precision_at_threshold", 3),
)
POSES = (
    Column("within 2 m, 5°", "within_2m_5deg", 3),
    Column("within 1 m, 10°", LEVEL_POSES, 3),
    Column("training's heading", "within_2m_5deg_same_heading", 3),
    Column("turned", "within_2m_5deg_turned", 3),
    Column("2 m or more beside", "within_2m_5deg_beside", 3),
    Column("within .5 m, 2°", "within_05m_2deg", 3),
    Column("error [m]", "error_m", 2),
    Column("error [°]", "error_deg", 2),
    Column("all poses, RMS [m]", "trajectory_m", 2),
    Column("wrong of accepted at .99", "wrong_of_accepted_99", 4),
    Column("recall at .99", "recall_99", 3),
)
ANSWERS = (
    *(Column(verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS),
    Column("calibration error", "pose_ece", 3),
)
BELIEVED = (
    Column("believed", "accepted", 0),
    Column("wrong", "accepted_wrong", 0),
    Column("wrong refused", "refused_wrong", 0),
)
ALTERATIONS = ("", "turned", "demolition", "construction")
CASES = 4  # at most so many kinds of altered queries have a column in the table `altered`
BY_CELLS = (measures.AUC, measures.KEPT, measures.RECALL, measures.AUROC)
BY_DISTANCE = (
    measures.FAR_AUC,
    measures.FAR,
    measures.FAR_AUROC,
    measures.OFF,
    measures.WITHIN,
)
STRESS = (
    measures.RECALL,
    measures.AUC,
    measures.AUROC,
    measures.FAR,
    measures.FAR_AUROC,
)
VIEWPOINTS = dict(zip(viewpoints.NUMBERS, ("ROC-AUC", "PR-AUC", "accuracy", "recall"), strict=True))
LEARNING = {
    "recall_of_all": "of all",
    "mean_recall": "mean",
    "forgetting": "forgetting",
    "transfer": "transfer",
}
ADOPTED = {
    "asked": "scans asked",
    "adopted": "adopted",
    "wrong": "of these wrong",
    "changed": "submaps changed",
}


def setup(study: Study, longest: int = 400) -> Table:
    """One row per model: what it is, its view, its share of full training, and its size.

    What it is has at most `longest` characters.
    """
    rows = []
    for model in (model for model in study.families if model in study.trained):
        record = study.models[model]
        what = catalogue.description_of(record.recipe.get("_target_", ""))
        best = "" if record.best_round is None else f", no. {record.best_round + 1} kept"
        rows.append(
            (
                model,
                shorten(what, longest, placeholder=" …") or MISSING,
                record.recipe.get("view", MISSING),
                record.recipe.get("budget", MISSING) if record.rounds else MISSING,
                f"{record.rounds} rounds{best}" if record.rounds else "nothing",
                number(record.megabytes, 1),
            )
        )
    header = ("model", "what it is", "looks at", "budget", "trained", "model [MB]")
    return table("setup", header, rows, words=5)


def sequences(study: Study) -> Table:
    """Table II of the SCI paper: each test sequence's age and how many of its queries are seen.

    A query is seen if training had been at its place; that is counted by both protocols.
    """
    rows = []
    for name, (result, *_) in by_sequence(study.results).items():
        queries = result.number("cells", "queries")
        near, far = (result.number("distance", key) for key in ("seen", "unseen"))
        seen, unseen = (result.number("cells", key) for key in ("seen", "unseen"))
        counts = (result.days, queries, near, far, queries - near - far, seen, unseen)
        rows.append((name, *map(count, counts), number(unseen / queries if queries else np.nan, 3)))
    by_distance = ("distance: seen", "unseen", "not judged")
    by_cells = ("cells: seen", "unseen", "share unseen")
    header = ("sequence", "days", "queries", *by_distance, *by_cells)
    return table("sequences", header, rows)


def costs(study: Study) -> Table | None:
    """One row per model, variants and seeds too: what training cost here, and a query's time.

    None if nothing was measured.
    """
    rows = []
    for model in study.settings.models:
        measured = indexed(pick(study.rows, **model.columns), "number")
        values = (measured.get(column.number, NONE)[0] for column in COSTS)
        rows.append((model.name, *map(number, values, [column.digits for column in COSTS])))
    costs_table = table("costs", ("model", *_heads(COSTS)), rows)
    is_measured = any(cell.key is not None for row in costs_table.rows for cell in row)
    return costs_table if is_measured else None


def scorecard(scores: Sequence[Scores]) -> Table:
    """Recall@1 by distance: one row per model, one column per test day, and more of the last day.

    The last columns are the share answered, the share of those right, the precision that the
    threshold kept on held-out blocks, and the time of a query where any was measured.
    """
    recall = over_days("scorecard", scores, "distance", "recall_at_1")
    timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    rows = []
    for cells, group in zip(recall.rows, by_model(scores).values(), strict=True):
        last = group[-1]
        precision = kept(last.kept, last.wanted_precision)
        rows.append([*cells, *_cells([last], ANSWERED, bounds=False), precision])
        if timed:
            rows[-1].append(number(last.number("", "query_ms"), 1))
    header = (*recall.header, *_heads(ANSWERED), "keeps", *["ms a query"] * timed)
    return table("scorecard", header, rows, last=recall.header[-1])


def over_days(kind: str, scores: Sequence[Scores], protocol: str, name: str) -> Table:
    """One number by one protocol: one row per model, one column per test day, with intervals.

    Each cell says which result it is of, so that the page's map can show it. A scorecard says
    where numbers are void.
    """
    rows = [
        (model, *(_of_day(score, kind, protocol, name) for score in group))
        for model, group in by_model(scores).items()
    ]
    return table(kind, ("method", *dates(scores).values()), rows)


def _of_day(score: Scores, kind: str, protocol: str, name: str) -> Cell:
    """The cell of `over_days` for one result."""
    is_void = kind == "scorecard" and score.void(protocol)
    cell = Cell(VOID) if is_void else _bounded(score.values(protocol, name), 3)
    return replace(cell, of=(score.model, score.sequence))


def believed(scores: Sequence[Scores]) -> Table:
    """How many answers of a model were believed on each day, and what the verdict got wrong."""
    days = dates(scores)
    rows = []
    for score in scores:
        date = Cell(days[score.sequence], of=(score.model, score.sequence))
        rows.append((date, *_cells([score], BELIEVED, bounds=False)))
    return table("believed", ("day", *_heads(BELIEVED)), rows)


def altered(study: Study, models: Iterable[str]) -> Table | None:
    """Recall@1 by distance on altered queries, beside queries as driven on the same days.

    One row per model that was asked altered queries; the last column is the change with age. None
    if no queries were altered.
    """
    rows = pick(study.rows[study.rows["change"].isin(ALTERATIONS)], seed=0, stress="")
    days = rows.loc[(rows["change"] != "") & (rows["sequence"] != ""), "sequence"].unique()
    if not len(days):
        return None
    comparison = Comparison(rows[rows["sequence"].isin(days)], {})
    kinds = comparison.kinds[: CASES + 1]
    per = f"recall_at_1_per_{PER_DAYS}_days"
    slopes = indexed(with_model(pick(study.driven, number=per)), "model")
    table_rows = []
    for model in (model for model in models if model in comparison.models):
        means = [comparison.measurement(model, kind, measures.FAR).mean for kind in kinds]
        if np.isfinite(means[1:]).any():
            slope, *interval = slopes.get(model, NONE)
            older = difference(slope, 3, interval)
            table_rows.append((model, *(number(value, 3) for value in means), older))
    names = ", ".join(dates(study.results).get(name, name) for name in days)
    header = ("method", *(kind.label for kind in kinds), f"{PER_DAYS} days older")
    return table("altered", header, table_rows, days=names) if table_rows else None


def main(study: Study, protocol: str, name: str) -> Table:
    """One of MAIN_NUMBERS: one row per model, one column per test day, the oracle last.

    Cells have 95 % intervals, and a mark where the paired test against the study's first method is
    clear. A mean over several days follows.
    """
    oracle, paired_number = MAIN_NUMBERS[name]
    days = dates(study.results)
    marks = _marks(study, protocol, paired_number)
    groups = by_model(study.results)
    rows: list[list[Cell | str]] = []
    for model in study.ranked:
        rows.append([model])
        for result in groups[model]:
            mark = marks.get((model, result.sequence), "")
            values = result.values(protocol, name)
            rows[-1].append(Cell(VOID) if result.void(protocol) else _bounded(values, 3, mark))
    first_of_day = [group[0] for group in by_sequence(study.results).values()]
    oracle_shares = [result.number(protocol, oracle.number) for result in first_of_day]
    rows.append([oracle.heading, *(number(share, 3) for share in oracle_shares)])
    header = [TITLES[name], *days.values()]
    if len(days) > 1:
        header.append("mean")
        shares = [[r.number(protocol, name) for r in groups[model]] for model in study.ranked]
        for row, of_days in zip(rows, [*shares, oracle_shares], strict=True):
            row.append(spread(of_days, 3))
    context: Any = {"protocol": protocol, "reference": study.families[0], "marked": bool(marks)}
    return replace(table(f"main_{name}", header, rows, **context), foot=True)


def _marks(study: Study, protocol: str, name: str) -> dict[tuple[str, str], str]:
    """Map model and sequence to `+` or `−` where the paired test of a number is clear."""
    tested = indexed(against(study.rows, protocol), "number", "model", "sequence")
    return {
        (model, sequence): "+" if values[0] > 0 else "−"
        for (key, model, sequence), values in tested.items()
        if key == f"{name}_difference" and tested[f"{key}_p", model, sequence][0] < LEVEL
    }


def means(study: Study) -> Table:
    """The other numbers of each model by both protocols: means over the test sequences."""
    columns = (*FURTHER, *HEADINGS)
    rows = [
        (model, protocol, *(number(mean(group, protocol, key), n) for _, key, n in columns))
        for protocol in DISTANCE_FIRST
        for model, group in by_model(study.results).items()
    ]
    return table("means", ("mean", "by", *_heads(columns)), rows, words=2)


def everything(study: Study, protocol: str) -> Table:
    """All numbers of each sequence and model by one protocol."""
    rows = [
        (name, result.model, *_cells([result], EVERYTHING, protocol, bounds=False))
        for name, group in by_sequence(study.results).items()
        for result in group
    ]
    header = ("sequence", "model", *_heads(EVERYTHING))
    return table("everything", header, rows, words=2, protocol=protocol)


def headings(study: Study) -> Table | None:
    """Errors of the headings by both protocols; None if no model gives a heading."""
    rows = []
    for model, group in by_model(study.results).items():
        if not any(np.isfinite(result.evaluation.heading_error_deg).any() for result in group):
            continue
        lines = [(result.sequence, [result]) for result in group]
        if len(group) > 1:
            lines.append(("mean", group))
        for name, results in lines:
            by_protocol = [_cells(results, HEADINGS, by) for by in DISTANCE_FIRST]
            rows.append((model, name, *chain(*by_protocol)))
    columns = [f"{head}, by {by}" for by in DISTANCE_FIRST for head in _heads(HEADINGS)]
    return table("headings", ("model", "sequence", *columns), rows, words=2) if rows else None


def poses(scores: Sequence[Scores]) -> list[Table]:
    """What a robot is told of the queries of each day, and how good the poses are."""
    words = ("model", "sequence")
    return [
        of_poses("pose_answers", words, scores, ANSWERS),
        of_poses("poses", words, scores, POSES),
    ]


def of_poses(
    kind: str, words: Sequence[str], scores: Sequence[Scores], columns: Sequence[Column]
) -> Table:
    """Some numbers of each model and test day by distance, with 95 % intervals.

    `words` head the columns of the model and of the day. The column of level sweeps is left out
    where there are none.
    """
    days = dates(scores)
    has_level = any(("distance", LEVEL_POSES) in score.numbers for score in scores)
    columns = [column for column in columns if has_level or column.number != LEVEL_POSES]
    rows = [(score.model, days[score.sequence], *_cells([score], columns)) for score in scores]
    return table(kind, (*words, *_heads(columns)), rows, words=2)


def novelties(study: Study, protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means, and the sequence of worst AUROC."""
    rows = []
    for model, group in by_model(study.results).items():
        judgements = [result.evaluation.protocol(protocol) for result in group]
        # (sequence, kind, measure)
        values = np.stack([judgement.rejection[:, :, 0] for judgement in judgements])
        for k, kind in enumerate(group[0].evaluation.kinds):
            auroc = values[:, k, MEASURES.index("auroc")]
            worst = int(np.nan_to_num(auroc, nan=np.inf).argmin())
            worst_day = f"on {day(group[worst].sequence)}" * bool(np.isfinite(auroc[worst]))
            rows.append(
                (
                    model,
                    kind if k else f"{kind}, in use",
                    *(number(average(over_sequences), 3) for over_sequences in values[:, k].T),
                    kept(group[0].evaluation.kept_precision[k], group[0].wanted_precision),
                    replace(number(auroc[worst], 3), small=worst_day),
                )
            )
    titles = ("AUROC", "AUC exact", "R@99%P", "precision", "recall", "keeps", "worst AUROC")
    return table("novelties", ("model", "novelty", *titles), rows, words=2, protocol=protocol)


def paired(study: Study, protocol: str) -> Table | None:
    """Every model against the first: differences with intervals, p, and who alone was right.

    None if there is one model.
    """
    rows = []
    reference = study.families[0]
    tested = against(study.rows, protocol)
    for (model, sequence), group in tested.groupby(["model", "sequence"], sort=False):
        values = indexed(group, "number")
        cells: list[Cell | str] = []
        for name in COMPARED:
            change, *interval = values[f"{name}_difference"]
            p = values[f"{name}_difference_p"][0]
            verdict = "undecided" if not p < LEVEL else "better" if change > 0 else "worse"
            cells += [difference(change, 3, interval), number(p, 3), verdict]
        alone = (count(values[f"only_{side}_right"][0]) for side in ("this", "reference"))
        rows.append((model, sequence, *cells, *alone))
    columns = [text for name in COMPARED for text in (f"Δ {TITLES[name]}", "p", "verdict")]
    header = ("model", "sequence", *columns, "only it right", f"only {reference} right")
    context = {"protocol": protocol, "reference": reference}
    return table("paired", header, rows, words=2, **context) if rows else None


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line fitted to one number over the days: one row per model, and one for the oracle."""
    lines = pick(rows, protocol=protocol)
    digits = 1 if name == PERCENTILE else 3
    per = f"per_{PER_DAYS}_days"
    table_rows = []
    for model in lines.loc[lines["number"] == f"{name}_line", "method"].unique():
        fitted = indexed(pick(lines, method=model), "number")
        slope, *interval = fitted.get(f"{name}_{per}", NONE)
        retrain_after, *retrain_interval = fitted.get(f"{name}_retrain_after_days", NONE)
        table_rows.append(
            (
                model,
                number(fitted.get(f"{name}_day_0", NONE)[0], digits),
                difference(slope, digits, interval),
                difference(fitted.get(f"{name}_theil_sen_{per}", NONE)[0], digits),
                number(fitted.get(f"{name}_slope_p", NONE)[0], 3),
                number(np.nan if model == ORACLE else retrain_after, 0, retrain_interval),
            )
        )
    columns = ("on day 0", f"per {PER_DAYS} days", "Theil–Sen", "p", "train again after [days]")
    return table("ageing", ("model", *columns), table_rows, title=title, per=PER_DAYS)


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number near real changes: one row per model, one column per band of distance.

    Below them stand the oracle's recall and the numbers of queries. `bands` maps the farthest
    distance of a band in metres to its name.
    """
    shown = pick(rows, change=SHOWN, protocol=protocol)
    values = indexed(shown, "number", "method", "level")
    models = shown["method"].unique()
    lines = [(model, name, model, 3) for model in models]
    if name == "recall_at_1":
        lines.append(("oracle", "oracle", models[0], 3))
    lines += [(f"{sight} queries", sight, models[0], 0) for sight in ("seen", "unseen")]
    table_rows = [
        (text, *(_bounded(values[key, model, edge], digits) for edge in bands))
        for text, key, model, digits in lines
    ]
    header = ("nearest change", *bands.values())
    return table("near_changes", header, table_rows, title=TITLES[name], protocol=protocol)


def every_case(comparison: Comparison, columns: Sequence[Measure]) -> Table:
    """One row per model and kind of case: means ± deviation over the sequences.

    The first measure also has its deviations over repeats and over seeds.
    """
    first, *others = columns
    rows = []
    for model, kind in product(comparison.ordered(comparison.kinds[-1], first), comparison.kinds):
        measurement = comparison.measurement(model, kind, first)
        chance = (number(measurement.over_repeats, 3), number(measurement.over_seeds, 3))
        mean, *means = (_over_sequences(comparison, model, kind, measure) for measure in columns)
        rows.append((model, kind.label, count(comparison.seeds[model]), mean, *chance, *means))
    deviations = ("± over repeats", "± over seeds")
    titles = [measure.title for measure in others]
    header = ("model", "queries", "seeds", first.title, *deviations, *titles)
    return table("every_case", header, rows, words=2, protocol=first.protocol)


def over_kinds(comparison: Comparison, measure: Measure) -> Table:
    """One measure: one row per model, one column per kind of case; means ± over the sequences."""
    kinds = [kind for kind in comparison.kinds if kind.change or not measure.relative]
    rows = [
        (model, *(_over_sequences(comparison, model, kind, measure) for kind in kinds))
        for model in comparison.ordered(kinds[-1], measure)
    ]
    header = ("model", *(kind.label for kind in kinds))
    return table("over_kinds", header, rows, title=measure.title)


def on_sequences(comparison: Comparison, kind: Kind, measure: Measure) -> Table:
    """One measure in one kind of case: one row per model, one column per sequence.

    Entries are means over the seeds ± deviation over the repeats.
    """
    rows = []
    for model in comparison.ordered(kind, measure):
        measurement = comparison.measurement(model, kind, measure)
        on_each = [measurement.on(i) for i in range(len(comparison.sequences))]
        rows.append((model, *(spread(on_one.by_repeat, measure.digits) for on_one in on_each)))
    header = ("model", *comparison.sequences)
    return table("on_sequences", header, rows, title=measure.title, kind=kind)


def stress(comparison: Comparison, titles: Mapping[str, str]) -> Table:
    """One row per sequence of stress and model, as driven: means ± deviation over the seeds."""
    models = comparison.ordered(Kind(), measures.RECALL)
    rows = []
    for (i, sequence), model in product(enumerate(comparison.sequences), models):
        numbers = [comparison.measurement(model, Kind(), measure).on(i) for measure in STRESS]
        cells = [spread(n.by_seed, m.digits) for n, m in zip(numbers, STRESS, strict=True)]
        rows.append((titles[sequence], model, count(comparison.seeds[model]), *cells))
    header = ("sequence", "model", "seeds", *(measure.title for measure in STRESS))
    return table("stress", header, rows, words=2)


def cells(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Table:
    """One number over cell sizes: one row per model, the best at the largest cells first.

    `values` maps a model to its values (sequence,) at each size; entries are means ± deviation
    over the sequences.
    """
    at_largest = {model: average(by_size[-1]) for model, by_size in values.items()}
    order = sorted(values, key=lambda model: -np.nan_to_num(at_largest[model], nan=-np.inf))
    rows = [(model, *(spread(by_sequence, 3) for by_sequence in values[model])) for model in order]
    return table("cells", ("model", *(f"{size_m:g} m" for size_m in sizes_m)), rows, title=title)


def over_headings(study: Study) -> list[Table]:
    """Paper 2's numbers, one row per sequence and model: means over headings, and over seeds.

    A table without rows is left out.
    """
    totals = indexed(
        with_model(pick(study.rows, change="viewpoint of all")), "sequence", "model", "number"
    )
    of_headings = []
    of_seeds = []
    for key, numbers in _by_heading(study):
        headings, seeds = (numbers.groupby(level).mean() for level in ("level", "seed"))
        with_auc = f"{int(np.isfinite(headings['roc_auc']).sum())} of {len(headings)}"
        sizes = (count(totals[(*key, name)][0]) for name in ("queries", "bytes_per_place"))
        means = (spread(headings[name], 3) for name in VIEWPOINTS)
        of_headings.append((*key, *means, with_auc, *sizes))
        if len(seeds) > 1:
            means = (spread(seeds[name], 3) for name in VIEWPOINTS)
            of_seeds.append((*key, *means, count(len(seeds))))
    header = ("sequence", "model", *VIEWPOINTS.values())
    last = ("headings with ROC-AUC", "queries", "bytes a place")
    candidates = (
        table("viewpoints_over_headings", (*header, *last), of_headings, words=2),
        table("viewpoints_over_seeds", (*header, "seeds"), of_seeds, words=2),
    )
    return [candidate for candidate in candidates if candidate.rows]


def every_heading(study: Study, name: str) -> Table:
    """One of paper 2's numbers: one column per heading, means over the seeds."""
    grouped = {key: numbers.groupby("level")[name] for key, numbers in _by_heading(study)}
    degrees = sorted({deg for groups in grouped.values() for deg in groups.groups})
    rows = [
        (*key, *(spread(groups.get_group(deg), 3) for deg in degrees))
        for key, groups in grouped.items()
    ]
    header = ("sequence", "model", *(f"{deg:g}°" for deg in degrees))
    return table("every_heading", header, rows, words=2, title=VIEWPOINTS[name])


def of_order(order: str, strategies: Sequence[Strategy]) -> list[Table]:
    """All tables of one order of learning further days."""
    tables = [learning(order, strategies)]
    if order == UPDATES:
        tables += [adopted(strategies), *(asked_days(strategies, by) for by in DISTANCE_FIRST)]
    return tables


def learning(order: str, strategies: Sequence[Strategy]) -> Table:
    """Recall and forgetting after the last step by both protocols, places, and costs of a step."""
    columns = list(product(DISTANCE_FIRST, LEARNING))
    rows = []
    for strategy in strategies:
        first, *_, last = strategy.over("places")[0]
        cpu_s = [average(seconds[1:]) for seconds in strategy.over("cpu_s")]
        rows.append(
            (
                strategy.model,
                strategy.name,
                *(spread(strategy.last(name, protocol), 3) for protocol, name in columns),
                Cell(f"{first:.0f} → {last:.0f}", float(last)),
                spread(strategy.last("bytes") / 1e6, 1),
                spread(cpu_s, 1),
            )
        )
    titles = [
        f"{protocol}: {LEARNING[name]}" if name == "recall_of_all" else LEARNING[name]
        for protocol, name in columns
    ]
    header = ("model", "strategy", *titles, "places", "model [MB]", "CPU [s] a step")
    return table("lifelong", header, rows, words=2, order=order)


def adopted(strategies: Sequence[Strategy]) -> Table:
    """The numbers of adopted scans and of changed submaps over all steps."""
    rows = [
        (strategy.model, strategy.name, *(spread(strategy.total(name), 0) for name in ADOPTED))
        for strategy in strategies
    ]
    return table("lifelong_adopted", ("model", "strategy", *ADOPTED.values()), rows, words=2)


def asked_days(strategies: Sequence[Strategy], protocol: str) -> Table:
    """Recall on each asked day before the first step and after the last."""
    days = list(dict.fromkeys(day for strategy in strategies for day in strategy.groups))
    rows = []
    for strategy in strategies:
        recall = [strategy.over("recall_at_1", protocol, day) for day in days]
        for when, step in (("before", 0), ("after", -1)):
            cells = [spread(of_day[:, step], 3) for of_day in recall]
            rows.append((strategy.model, strategy.name, when, *cells))
    header = ("model", "strategy", "when", *days)
    return table("lifelong_asked", header, rows, words=3, protocol=protocol)


def _heads(columns: Sequence[Column]) -> list[str]:
    return [column.heading for column in columns]


def _bounded(values: Values, digits: int, mark: str = "") -> Cell:
    """A cell of a number with its interval."""
    value, *interval = values
    return number(value, digits, interval, mark)


def _cells(
    results: Sequence[Scores],
    columns: Sequence[Column],
    protocol: str = "distance",
    bounds: bool = True,
) -> list[Cell]:
    """A cell per column: one result's number, with its interval if `bounds`; mean ± of several."""
    if len(results) > 1:
        return [spread([r.number(protocol, name) for r in results], n) for _, name, n in columns]
    (result,) = results
    if bounds:
        return [_bounded(result.values(protocol, name), n) for _, name, n in columns]
    return [number(result.number(protocol, name), n) for _, name, n in columns]


def _over_sequences(comparison: Comparison, model: str, kind: Kind, measure: Measure) -> Cell:
    return spread(comparison.measurement(model, kind, measure).by_sequence, measure.digits)


def _by_heading(study: Study) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """For each sequence and model a table of numbers, one row per seed and heading (`level`)."""
    rows = with_model(pick(study.rows, change="viewpoint"))
    for key, group in rows.groupby(["sequence", "model"], sort=False):
        yield key, group.pivot(index=["seed", "level"], columns="number", values="value")
