"""Tables of altered queries, sequences of stress and cell sizes.

Entries are means and deviations over sequences, seeds and repeats.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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
from pipeline.report.table import Cell, Table, count, number, spread, table

BY_CELLS = (AUC, KEPT, RECALL, AUROC)
BY_DISTANCE = (FAR_AUC, FAR, FAR_AUROC, OFF, WITHIN)


def _over_sequences(comparison: Comparison, model: str, kind: Kind, measure: Measure) -> Cell:
    return spread(comparison.measurement(model, kind, measure).by_sequence, measure.digits)


def every_case(comparison: Comparison, measures: Sequence[Measure]) -> Table:
    """A row a model and kind of case: means ± deviation over the sequences.

    For the first measure also the deviations over repeats and over seeds.
    """
    first = measures[0]
    rows = []
    for model in comparison.ordered(comparison.kinds[-1], first):
        for kind in comparison.kinds:
            measurement = comparison.measurement(model, kind, first)
            cells = [_over_sequences(comparison, model, kind, measure) for measure in measures]
            chance = (number(measurement.over_repeats, 3), number(measurement.over_seeds, 3))
            rows.append(
                (model, kind.label, count(comparison.seeds[model]), cells[0], *chance, *cells[1:])
            )
    titles = [measure.title for measure in measures]
    header = ("model", "queries", "seeds", titles[0], "± over repeats", "± over seeds", *titles[1:])
    return table("every_case", header, rows, words=2, protocol=first.protocol)


def over_kinds(comparison: Comparison, measure: Measure) -> Table:
    """One measure: a row a model, a column a kind of case; means ± deviation over the sequences."""
    kinds = [kind for kind in comparison.kinds if kind.change or not measure.relative]
    models = comparison.ordered(kinds[-1], measure)
    rows = [
        (model, *(_over_sequences(comparison, model, kind, measure) for kind in kinds))
        for model in models
    ]
    return table(
        "over_kinds", ("model", *(kind.label for kind in kinds)), rows, title=measure.title
    )


def on_sequences(comparison: Comparison, kind: Kind, measure: Measure) -> Table:
    """One measure in one kind of case: a row a model, a column a sequence.

    Entries are means over the seeds ± deviation over the repeats.
    """
    rows = []
    for model in comparison.ordered(kind, measure):
        measurements = (
            comparison.measurement(model, kind, measure).on(i)
            for i in range(len(comparison.sequences))
        )
        rows.append(
            (
                model,
                *(spread(measurement.by_repeat, measure.digits) for measurement in measurements),
            )
        )
    return table(
        "on_sequences", ("model", *comparison.sequences), rows, title=measure.title, kind=kind
    )


def stress(comparison: Comparison, titles: Mapping[str, str]) -> Table:
    """A row a sequence of stress and model, as driven: means ± deviation over the seeds."""
    measures = (RECALL, AUC, AUROC, FAR, FAR_AUROC)
    rows = []
    for i, sequence in enumerate(comparison.sequences):
        for model in comparison.ordered(Kind(), RECALL):
            cells = [
                spread(comparison.measurement(model, Kind(), measure).on(i).by_seed, measure.digits)
                for measure in measures
            ]
            rows.append((titles[sequence], model, count(comparison.seeds[model]), *cells))
    return table(
        "stress",
        ("sequence", "model", "seeds", *(measure.title for measure in measures)),
        rows,
        words=2,
    )


def cells(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Table:
    """One number: a row a model, the best at the largest cells first; a column a cell size.

    Entries are means ± deviation over the sequences.
    """
    order = sorted(
        values,
        key=lambda model: -float(np.mean(values[model][-1])) if len(values[model][-1]) else np.inf,
    )
    rows = [(model, *(spread(by_sequence, 3) for by_sequence in values[model])) for model in order]
    return table("cells", ("model", *(f"{size_m:g} m" for size_m in sizes_m)), rows, title=title)
