"""The tables of a study of robustness: altered queries, stress, real changes and cell sizes.

A kind (`comparison.Kind`) is what was done to queries, such as `turned`; an empty one is queries as
driven.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.rows import NEAR_CHANGE, PERTURBED, UNPERTURBED
from pipeline.evaluation.study_rows import PER_DAYS, SHOWN
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
from pipeline.report.result import TITLES, dates
from pipeline.report.selection import NONE, indexed, pick
from pipeline.report.study import Study
from pipeline.report.table import (
    Cell,
    Table,
    average,
    count,
    difference,
    number,
    spread,
    table,
)
from pipeline.report.tables.columns import bounded

MOST_ALTERED_KINDS = 4  # of altered queries that have a column in `altered`
# The columns of the two tables `every_case`, by cells and by distance.
BY_CELLS = (AUC, KEPT, RECALL, AUROC)
BY_DISTANCE = (FAR_AUC, FAR, FAR_AUROC, OFF, WITHIN)
# The columns of `stress`.
STRESS = (RECALL, AUC, AUROC, FAR, FAR_AUROC)


def altered(study: Study, models: Iterable[str]) -> Table | None:
    """Recall@1 by distance on altered queries, beside queries as driven on the same days.

    One row per model that was asked altered queries; the last column is the change with age. None
    if no queries were altered.
    """
    rows = pick(study.rows[study.rows["ask"].isin([UNPERTURBED, PERTURBED])], seed=0)
    days = pick(rows, ask=PERTURBED)["sequence"].unique()
    if not len(days):
        return None
    comparison = Comparison(rows[rows["sequence"].isin(days)], {})
    kinds = comparison.kinds[: 1 + MOST_ALTERED_KINDS]  # queries as driven come first
    slope_name = f"recall_at_1_per_{PER_DAYS}_days"
    slopes = indexed(pick(study.driven, number=slope_name), "model")
    table_rows = []
    for model in models:
        if model not in comparison.models:
            continue
        recalls = [comparison.measurement(model, kind, FAR).mean for kind in kinds]
        if np.isfinite(recalls[1:]).any():
            slope, *interval = slopes.get(model, NONE)
            recall_cells = [number(recall, 3) for recall in recalls]
            table_rows.append((model, *recall_cells, difference(slope, 3, interval)))
    day_names = ", ".join(dates(study.results).get(name, name) for name in days)
    header = ("method", *(kind.label for kind in kinds), f"{PER_DAYS} days older")
    return table("altered", header, table_rows, days=day_names) if table_rows else None


def every_case(comparison: Comparison, measures: Sequence[Measure]) -> Table:
    """One row per model and kind of query: means ± deviation over the sequences.

    The first measure also has its deviations over repeats and over seeds.
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
                _over_sequences(comparison, model, kind, first),
                number(measurement.over_repeats, 3),
                number(measurement.over_seeds, 3),
                *(_over_sequences(comparison, model, kind, measure) for measure in others),
            )
        )
    deviations = ("± over repeats", "± over seeds")
    titles = [measure.title for measure in others]
    header = ("model", "queries", "seeds", first.title, *deviations, *titles)
    return table("every_case", header, rows, text_columns=2, protocol=first.protocol)


def over_kinds(comparison: Comparison, measure: Measure) -> Table:
    """One measure: one row per model, one column per kind of query; means ± over the sequences.

    A measure relative to queries as driven has no column for these.
    """
    kinds = comparison.changes if measure.relative else comparison.kinds
    rows = [
        (model, *(_over_sequences(comparison, model, kind, measure) for kind in kinds))
        for model in comparison.ordered(kinds[-1], measure)
    ]
    header = ("model", *(kind.label for kind in kinds))
    return table("over_kinds", header, rows, title=measure.title)


def on_sequences(comparison: Comparison, kind: Kind, measure: Measure) -> Table:
    """One measure on one kind of query: one row per model, one column per sequence.

    Entries are means over the seeds ± deviation over the repeats.
    """
    rows = []
    for model in comparison.ordered(kind, measure):
        measurement = comparison.measurement(model, kind, measure)
        row: list[Cell | str] = [model]
        for i in range(len(comparison.sequences)):
            row.append(spread(measurement.on(i).by_repeat, measure.digits))
        rows.append(row)
    header = ("model", *comparison.sequences)
    return table("on_sequences", header, rows, title=measure.title, kind=kind)


def stress(comparison: Comparison, titles: Mapping[str, str]) -> Table:
    """One row per sequence of stress and model, as driven: means ± deviation over the seeds."""
    as_driven = Kind()
    models = comparison.ordered(as_driven, RECALL)
    rows = []
    for (i, sequence), model in product(enumerate(comparison.sequences), models):
        row: list[Cell | str] = [titles[sequence], model, count(comparison.seeds[model])]
        for measure in STRESS:
            measurement = comparison.measurement(model, as_driven, measure).on(i)
            row.append(spread(measurement.by_seed, measure.digits))
        rows.append(row)
    header = ("sequence", "model", "seeds", *(measure.title for measure in STRESS))
    return table("stress", header, rows, text_columns=2)


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number near real changes: one row per model, one column per band of distance.

    Below them stand the oracle's recall and the numbers of queries. `bands` maps the farthest
    distance of a band in metres to its name.
    """
    shown = pick(rows, ask=NEAR_CHANGE, of=SHOWN, protocol=protocol)
    shown = shown[shown["method"] != ""]
    # in these rows `at` is the farthest distance of the band
    values = indexed(shown, "number", "method", "at")

    def over_bands(label: str, number_name: str, model: str, digits: int) -> list[Cell | str]:
        cells = [bounded(values[number_name, model, edge_m], digits) for edge_m in bands]
        return [label, *cells]

    models = shown["method"].unique()
    table_rows = [over_bands(model, name, model, 3) for model in models]
    # the oracle and the numbers of queries are the same for every model
    if name == "recall_at_1":
        table_rows.append(over_bands("oracle", "oracle", models[0], 3))
    for sight in ("seen", "unseen"):
        table_rows.append(over_bands(f"{sight} queries", sight, models[0], 0))
    header = ("nearest change", *bands.values())
    return table("near_changes", header, table_rows, title=TITLES[name], protocol=protocol)


def over_cell_sizes(
    values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]
) -> Table:
    """One number over cell sizes: one row per model, the best at the largest cells first.

    `values` maps a model to its values (sequence,) at each size; entries are means ± deviation
    over the sequences.
    """
    at_largest = {model: average(by_size[-1]) for model, by_size in values.items()}
    order = sorted(values, key=lambda model: -np.nan_to_num(at_largest[model], nan=-np.inf))
    rows = [(model, *(spread(at_size, 3) for at_size in values[model])) for model in order]
    return table("cells", ("model", *(f"{size_m:g} m" for size_m in sizes_m)), rows, title=title)


def _over_sequences(comparison: Comparison, model: str, kind: Kind, measure: Measure) -> Cell:
    """The mean of a measure ± its deviation over the sequences."""
    return spread(comparison.measurement(model, kind, measure).by_sequence, measure.digits)
