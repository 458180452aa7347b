"""The tables of a report: each a selection of the table of results, a row a model.

Every cell is a row of the table of results, or a mean and deviation over some of its rows.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, replace
from textwrap import shorten
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation import viewpoints
from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.judgement import VERDICTS
from pipeline.evaluation.numbers import LEVEL_POSES, MEASURES
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, SHOWN
from pipeline.report.comparison import (
    AUC,
    AUROC,
    FAR,
    FAR_AUC,
    FAR_AUROC,
    KEPT,
    OFF,
    RECALL,
    WITHIN,
    Comparison,
    Kind,
    Measure,
)
from pipeline.report.result import TITLES, Scores, by_model, by_sequence, dates, day, mean
from pipeline.report.selection import NONE, Values, indexed, pick
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
from pipeline.studies.models import ModelName

Columns = Sequence[tuple[str, str, int]]  # heading, number of the table of results, digits
DISTANCE_FIRST = PROTOCOLS[::-1]
"""The protocols in the order in which people ask."""
MAIN_NUMBERS = {
    "recall_at_1": ("oracle", "oracle", "recall_at_1"),
    "auc_top1": ("oracle, exact", "oracle_auc_exact_top1", "auc_exact_top1"),
}
"""The numbers that a study is about. Of each, the heading and the number of the oracle's row, and
the number of the paired test whose mark stands behind it: the SCI paper's area and the exact one
differ little."""
HEADINGS = (
    ("heading error [°]", "median_heading_error_deg", 1),
    ("within 10°", "heading_within_10deg", 3),
)
FURTHER = (
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
)
EVERYTHING = (
    ("recall@1", "recall_at_1", 3),
    ("oracle", "oracle", 3),
    ("AUC top-1", "auc_top1", 3),
    *FURTHER,
)
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
ANSWERS = (
    *((verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS),
    ("calibration error", "pose_ece", 3),
)
BELIEVED = (
    ("believed", "accepted", 0),
    ("wrong", "accepted_wrong", 0),
    ("wrong refused", "refused_wrong", 0),
)
ALTERATIONS = ("", "turned", "demolition", "construction")
CASES = 4  # so many kinds of altered queries have a column beside those as driven
BY_CELLS = (AUC, KEPT, RECALL, AUROC)
BY_DISTANCE = (FAR_AUC, FAR, FAR_AUROC, OFF, WITHIN)
STRESS = (RECALL, AUC, AUROC, FAR, FAR_AUROC)
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
    """A row a model: what it is, its view, its share of full training, and its size."""
    rows = []
    for model in (model for model in study.families if model in study.trained):
        record = study.models[model]
        what = catalogue.what(record.recipe.get("_target_", ""))
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

    Counts are by both protocols.
    """
    rows = []
    for name, (result, *_) in by_sequence(study.results).items():
        queries = result.number("cells", "queries")
        near, far = (result.number("distance", key) for key in ("seen", "unseen"))
        seen, unseen = (result.number("cells", key) for key in ("seen", "unseen"))
        counts = (result.days, queries, near, far, queries - near - far, seen, unseen)
        rows.append((name, *map(count, counts), number(unseen / queries if queries else np.nan, 3)))
    distance = ("distance: seen", "unseen", "not judged")
    cells = ("cells: seen", "unseen", "share unseen")
    return table("sequences", ("sequence", "days", "queries", *distance, *cells), rows)


def costs(study: Study) -> Table | None:
    """A row a model, variants and seeds too: what training cost here, and a query's time.

    None where nothing was measured.
    """
    values = {
        (ModelName(*names).name, key): value
        for (*names, key), (value, *_) in indexed(
            study.rows, "method", "variant", "seed", "number"
        ).items()
    }
    rows = [
        (model, *(number(values.get((model, key), np.nan), digits) for _, key, digits in COSTS))
        for model in study.trained
    ]
    costs_table = table("costs", ("model", *_heads(COSTS)), rows)
    is_measured = any(cell.key is not None for row in costs_table.rows for cell in row)
    return costs_table if is_measured else None


def scorecard(scores: Sequence[Scores]) -> Table:
    """Recall@1 by distance: a row a model, a column a test day; then columns for the last day.

    These are: share answered, share of those right, precision promised by held-out blocks, time.
    """
    right = over_days("scorecard", scores, "distance", "recall_at_1")
    timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    answers = (("answers", "answered", 3), ("right of those", "precision_at_threshold", 3))
    rows = [
        (
            *cells,
            *_cells([last], answers, bounds=False),
            kept(last.kept, last.wanted_precision),
            *[number(last.number("", "query_ms"), 1)] * timed,
        )
        for cells, (*_, last) in zip(right.rows, by_model(scores).values(), strict=True)
    ]
    header = (*right.header, *_heads(answers), "keeps", *["ms a query"] * timed)
    return table("scorecard", header, rows, last=right.header[-1])


def over_days(kind: str, scores: Sequence[Scores], protocol: str, name: str) -> Table:
    """One number by one protocol: a row a model, a column a test day, with 95 % intervals."""
    rows = [
        (
            model,
            *(
                replace(
                    Cell(VOID)
                    if kind == "scorecard" and score.void(protocol)
                    else _number(score.values(protocol, name), 3),
                    of=(model, score.sequence),  # the page's map can show it
                )
                for score in group
            ),
        )
        for model, group in by_model(scores).items()
    ]
    return table(kind, ("method", *dates(scores).values()), rows)


def believed(scores: Sequence[Scores]) -> Table:
    """How many answers of a model were believed on each day, and what the verdict got wrong."""
    days = dates(scores)
    rows = [
        (
            Cell(days[score.sequence], of=(score.model, score.sequence)),
            *_cells([score], BELIEVED, bounds=False),
        )
        for score in scores
    ]
    return table("believed", ("day", *_heads(BELIEVED)), rows)


def altered(study: Study, models: Iterable[str]) -> Table | None:
    """Recall@1 by distance: a row a model, as driven and on altered queries.

    On the same days; None if none are altered. The last column is the change with age.
    """
    rows = pick(study.rows, protocol="distance", number="recall_at_1", kind="", seed=0, stress="")
    rows = rows[rows["change"].isin(ALTERATIONS) & (rows["sequence"] != "")]
    days = rows.loc[rows["change"] != "", "sequence"].unique()
    rows = rows[rows["sequence"].isin(days)]
    cases = rows[["change", "level", "shadow"]].drop_duplicates().itertuples(index=False)
    kinds = sorted((Kind(*case) for case in cases), key=lambda kind: kind.change != "")
    means = rows.groupby(["method", "variant", "change", "level", "shadow"])["value"].mean()
    per = f"recall_at_1_per_{PER_DAYS}_days"
    slopes = indexed(pick(study.driven, number=per), "method", "variant")
    table_rows = []
    for model in models:
        method, _, variant = model.partition("-")
        values = [
            means.get((method, variant, *astuple(kind)), np.nan) for kind in kinds[: CASES + 1]
        ]
        if np.isfinite(values[1:]).any():
            slope = slopes.get((method, variant), NONE)
            older = difference(slope[0], 3, slope[1:])
            table_rows.append((model, *(number(value, 3) for value in values), older))
    names = ", ".join(dates(study.results).get(name, name) for name in days)
    header = ("method", *(kind.label for kind in kinds[: CASES + 1]), f"{PER_DAYS} days older")
    return table("altered", header, table_rows, days=names) if table_rows else None


def main(study: Study, protocol: str, name: str) -> Table:
    """One of MAIN_NUMBERS: a row a model, a column a test day, the oracle last.

    Cells have 95 % intervals, and a mark where the paired test against the study's first method is
    clear.
    """
    oracle_heading, oracle_number, paired_number = MAIN_NUMBERS[name]
    days = dates(study.results)
    several = len(days) > 1
    values = indexed(against(study.rows, protocol), "number", "model", "sequence")
    marks = {
        (model, sequence): "+" if difference_[0] > 0 else "−"
        for (key, model, sequence), difference_ in values.items()
        if key == f"{paired_number}_difference" and values[f"{key}_p", model, sequence][0] < LEVEL
    }
    models = by_model(study.results)
    rows: list[Sequence[Cell | str]] = [
        (
            model,
            *(
                Cell(VOID)
                if result.void(protocol)
                else _number(
                    result.values(protocol, name), 3, marks.get((model, result.sequence), "")
                )
                for result in models[model]
            ),
            *[spread([result.number(protocol, name) for result in models[model]], 3)] * several,
        )
        for model in study.ranked
    ]
    oracle = [
        group[0].number(protocol, oracle_number) for group in by_sequence(study.results).values()
    ]
    oracle_cells = [number(value, 3) for value in oracle]
    rows.append((oracle_heading, *oracle_cells, *[spread(oracle, 3)] * several))
    header = (TITLES[name], *days.values(), *["mean"] * several)
    context: Any = {"protocol": protocol, "reference": study.families[0], "marked": bool(marks)}
    return replace(table(f"main_{name}", header, rows, **context), foot=True)


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
    """Errors of the headings by both protocols; None where no model gives a heading."""
    rows = [
        (model, name, *(c for by in DISTANCE_FIRST for c in _cells(results, HEADINGS, by)))
        for model, group in by_model(study.results).items()
        if any(np.isfinite(result.evaluation.heading_error_deg).any() for result in group)
        for name, results in [
            *((result.sequence, [result]) for result in group),
            *[("mean", group)] * (len(group) > 1),
        ]
    ]
    header = [f"{head}, by {protocol}" for protocol in DISTANCE_FIRST for head in _heads(HEADINGS)]
    return table("headings", ("model", "sequence", *header), rows, words=2) if rows else None


def poses(scores: Sequence[Scores]) -> list[Table]:
    """What a robot is told of the queries of each day, and how good the poses are."""
    words = ("model", "sequence")
    return [
        of_poses("pose_answers", words, scores, ANSWERS),
        of_poses("poses", words, scores, POSES),
    ]


def of_poses(kind: str, words: Sequence[str], scores: Sequence[Scores], columns: Columns) -> Table:
    """Some numbers of each model and test day by distance, with 95 % intervals.

    `words` head the columns of the model and of the day. The column of level sweeps is left out
    where there are none.
    """
    days = dates(scores)
    has_level = any(("distance", LEVEL_POSES) in score.numbers for score in scores)
    columns = [column for column in columns if has_level or column[1] != LEVEL_POSES]
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
                    kind + ("" if k else ", in use"),
                    *(number(average(of_days), 3) for of_days in values[:, k].T),
                    kept(group[0].evaluation.kept_precision[k], group[0].wanted_precision),
                    replace(number(auroc[worst], 3), small=worst_day),
                )
            )
    titles = ("AUROC", "AUC exact", "R@99%P", "precision", "recall", "keeps", "worst AUROC")
    return table("novelties", ("model", "novelty", *titles), rows, words=2, protocol=protocol)


def paired(study: Study, protocol: str) -> Table | None:
    """Every model against the first: differences with intervals, p, and who alone was right.

    None where there is one model.
    """
    rows = []
    reference = study.families[0]
    paired_rows = against(study.rows, protocol)
    for (model, sequence), group in paired_rows.groupby(["model", "sequence"], sort=False):
        values = indexed(group, "number")
        cells: list[Cell | str] = []
        for name in COMPARED:
            change, low, high = values[f"{name}_difference"]
            p, *_ = values[f"{name}_difference_p"]
            verdict = "undecided" if not p < LEVEL else "better" if change > 0 else "worse"
            cells += [difference(change, 3, (low, high)), number(p, 3), verdict]
        alone = (count(values[f"only_{side}_right"][0]) for side in ("this", "reference"))
        rows.append((model, sequence, *cells, *alone))
    columns = [text for name in COMPARED for text in (f"Δ {TITLES[name]}", "p", "verdict")]
    header = ("model", "sequence", *columns, "only it right", f"only {reference} right")
    context = {"protocol": protocol, "reference": reference}
    return table("paired", header, rows, words=2, **context) if rows else None


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line through one number over the days: a row a model and the oracle."""
    values = indexed(rows[rows["protocol"] == protocol], "method", "number")
    digits = 1 if name == "novelty_percentile" else 3
    per = f"per_{PER_DAYS}_days"
    ends = ("day_0", per, f"theil_sen_{per}", "slope_p", "retrain_after_days")
    table_rows = []
    for model in rows.loc[rows["number"] == f"{name}_line", "method"].unique():
        first, slope, middle, p, retrain_after = (
            values.get((model, f"{name}_{end}"), NONE) for end in ends
        )
        table_rows.append(
            (
                model,
                number(first[0], digits),
                difference(slope[0], digits, slope[1:]),
                difference(middle[0], digits),
                number(p[0], 3),
                number(np.nan if model == ORACLE else retrain_after[0], 0, retrain_after[1:]),
            )
        )
    lines = ("on day 0", f"per {PER_DAYS} days", "Theil–Sen", "p", "train again after [days]")
    header = ("model", *lines)
    return table("ageing", header, table_rows, title=title, per=PER_DAYS)


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number by one protocol: a row a model, a column a band of distance, with intervals.

    Below them stand the oracle and the numbers of queries.
    """
    shown = pick(rows, change=SHOWN, protocol=protocol)
    values = indexed(shown, "number", "method", "level")
    models = shown["method"].unique()
    lines = [(model, name, model, 3) for model in models]
    lines += [("oracle", "oracle", models[0], 3)] * (name == "recall_at_1")
    lines += [(f"{sight} queries", sight, models[0], 0) for sight in ("seen", "unseen")]
    table_rows = [
        (text, *(_number(values[key, model, edge], digits) for edge in bands))
        for text, key, model, digits in lines
    ]
    header = ("nearest change", *bands.values())
    return table("near_changes", header, table_rows, title=TITLES[name], protocol=protocol)


def every_case(comparison: Comparison, measures: Sequence[Measure]) -> Table:
    """A row a model and kind of case: means ± deviation over the sequences.

    For the first measure also the deviations over repeats and over seeds.
    """
    first, *others = measures
    rows = [
        (
            model,
            kind.label,
            count(comparison.seeds[model]),
            spread(measurement.by_sequence, first.digits),
            number(measurement.over_repeats, 3),
            number(measurement.over_seeds, 3),
            *(_over_sequences(comparison, model, kind, measure) for measure in others),
        )
        for model in comparison.ordered(comparison.kinds[-1], first)
        for kind in comparison.kinds
        for measurement in [comparison.measurement(model, kind, first)]
    ]
    chance = ("± over repeats", "± over seeds")
    titles = [measure.title for measure in others]
    header = ("model", "queries", "seeds", first.title, *chance, *titles)
    return table("every_case", header, rows, words=2, protocol=first.protocol)


def over_kinds(comparison: Comparison, measure: Measure) -> Table:
    """One measure: a row a model, a column a kind of case; means ± deviation over the sequences."""
    kinds = [kind for kind in comparison.kinds if kind.change or not measure.relative]
    rows = [
        (model, *(_over_sequences(comparison, model, kind, measure) for kind in kinds))
        for model in comparison.ordered(kinds[-1], measure)
    ]
    header = ("model", *(kind.label for kind in kinds))
    return table("over_kinds", header, rows, title=measure.title)


def on_sequences(comparison: Comparison, kind: Kind, measure: Measure) -> Table:
    """One measure in one kind of case: a row a model, a column a sequence.

    Entries are means over the seeds ± deviation over the repeats.
    """
    rows = [
        (
            model,
            *(
                spread(comparison.measurement(model, kind, measure).on(i).by_repeat, measure.digits)
                for i in range(len(comparison.sequences))
            ),
        )
        for model in comparison.ordered(kind, measure)
    ]
    header = ("model", *comparison.sequences)
    return table("on_sequences", header, rows, title=measure.title, kind=kind)


def stress(comparison: Comparison, titles: Mapping[str, str]) -> Table:
    """A row a sequence of stress and model, as driven: means ± deviation over the seeds."""
    rows = [
        (
            titles[sequence],
            model,
            count(comparison.seeds[model]),
            *(
                spread(comparison.measurement(model, Kind(), measure).on(i).by_seed, measure.digits)
                for measure in STRESS
            ),
        )
        for i, sequence in enumerate(comparison.sequences)
        for model in comparison.ordered(Kind(), RECALL)
    ]
    header = ("sequence", "model", "seeds", *(measure.title for measure in STRESS))
    return table("stress", header, rows, words=2)


def cells(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Table:
    """One number: a row a model, the best at the largest cells first; a column a cell size.

    Entries are means ± deviation over the sequences.
    """
    last = {model: average(by_size[-1]) for model, by_size in values.items()}
    order = sorted(values, key=lambda model: -np.nan_to_num(last[model], nan=-np.inf))
    rows = [(model, *(spread(by_sequence, 3) for by_sequence in values[model])) for model in order]
    return table("cells", ("model", *(f"{size_m:g} m" for size_m in sizes_m)), rows, title=title)


def over_headings(study: Study) -> list[Table]:
    """Paper 2's numbers, a row a sequence and model: means over the headings, and over the seeds.

    Tables without rows are left out.
    """
    totals = indexed(_with_model(study, "viewpoint of all"), "sequence", "model", "number")
    of_headings = []
    of_seeds = []
    for key, wide in _by_heading(study):
        headings, seeds = (wide.groupby(level).mean() for level in ("level", "seed"))
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
    """One of paper 2's numbers: a column a heading, means over the seeds."""
    grouped = {key: wide.groupby("level")[name] for key, wide in _by_heading(study)}
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
    rows = []
    for strategy in strategies:
        first, *_, last = strategy.over("places")[0]
        rows.append(
            (
                strategy.model,
                strategy.name,
                *(spread(strategy.last(n, by), 3) for by in DISTANCE_FIRST for n in LEARNING),
                Cell(f"{first:.0f} → {last:.0f}", float(last)),
                spread(strategy.last("bytes") / 1e6, 1),
                spread([average(seconds[1:]) for seconds in strategy.over("cpu_s")], 1),
            )
        )
    columns = [
        f"{protocol}: {title}" if title == "of all" else title
        for protocol in DISTANCE_FIRST
        for title in LEARNING.values()
    ]
    header = ("model", "strategy", *columns, "places", "model [MB]", "CPU [s] a step")
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
    rows = [
        (
            strategy.model,
            strategy.name,
            when,
            *(spread(strategy.over("recall_at_1", protocol, day)[:, step], 3) for day in days),
        )
        for strategy in strategies
        for step, when in ((0, "before"), (-1, "after"))
    ]
    header = ("model", "strategy", "when", *days)
    return table("lifelong_asked", header, rows, words=3, protocol=protocol)


def _heads(columns: Columns) -> list[str]:
    return [heading for heading, *_ in columns]


def _number(values: Values, digits: int, mark: str = "") -> Cell:
    """A cell of a number and its interval."""
    return number(values[0], digits, values[1:], mark)


def _cells(
    results: Sequence[Scores], columns: Columns, protocol: str = "distance", bounds: bool = True
) -> list[Cell]:
    """A cell a column: one result's number, with its interval if `bounds`; mean ± of several."""
    if len(results) > 1:
        return [spread([r.number(protocol, name) for r in results], n) for _, name, n in columns]
    (result,) = results
    if not bounds:
        return [number(result.number(protocol, name), n) for _, name, n in columns]
    return [_number(result.values(protocol, name), n) for _, name, n in columns]


def _over_sequences(comparison: Comparison, model: str, kind: Kind, measure: Measure) -> Cell:
    return spread(comparison.measurement(model, kind, measure).by_sequence, measure.digits)


def _with_model(study: Study, change: str) -> pd.DataFrame:
    """The rows of a change, with a column `model`: the method, or a variant of it."""
    rows = pick(study.rows, change=change)
    model = rows["method"].where(rows["variant"] == "", rows["method"] + "-" + rows["variant"])
    return rows.assign(model=model)


def _by_heading(study: Study) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """For each sequence and model a table of numbers: a row a seed and heading (`level`)."""
    groups = _with_model(study, "viewpoint").groupby(["sequence", "model"], sort=False)
    for key, group in groups:
        yield key, group.pivot(index=["seed", "level"], columns="number", values="value")
