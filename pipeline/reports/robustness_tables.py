"""The numbers of a study of robustness as tables: every case, levels side by side, sequence by sequence."""

from collections.abc import Mapping, Sequence

from pipeline.alterations import AS_DRIVEN, Case
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_numbers import (
    AUC,
    AUROC,
    FAR,
    FAR_AUC,
    FAR_AUROC,
    KEPT,
    OFF,
    RECALL,
    WITHIN,
    Found,
    Measure,
    label,
)
from pipeline.reports.table import Table, number, spread

BY_CELLS = (AUC, KEPT, RECALL, AUROC)
BY_DISTANCE = (FAR_AUC, FAR, FAR_AUROC, OFF, WITHIN)


def every_case(answers: Answers, measures: Sequence[Measure]) -> Table:
    """A row a model and kind of case: means ± deviation over the sequences; of the first measure, over repeats and seeds."""
    first, rows = measures[0], []
    for model in answers.ordered(answers.kinds[-1], first):
        for kind in answers.kinds:
            found = answers.found(model, kind, first)
            told = [over_sequences(answers.found(model, kind, measure), measure) for measure in measures]
            chance = (number(found.over_repeats, 3), number(found.over_seeds, 3))
            rows.append((model, label(kind), str(len(answers.judged[model])), told[0], *chance, *told[1:]))
    titles = [measure.title for measure in measures]
    header = ("model", "queries", "seeds", titles[0], "± over repeats", "± over seeds", *titles[1:])
    return Table(header, tuple(rows), words=2)


def over_kinds(answers: Answers, measure: Measure) -> Table:
    """One measure: a row a model, a column a kind of case; means ± deviation over the sequences."""
    kinds = [kind for kind in answers.kinds if not (measure.relative and kind.change == AS_DRIVEN)]
    rows = [
        (model, *(over_sequences(answers.found(model, kind, measure), measure) for kind in kinds))
        for model in answers.ordered(kinds[-1], measure)
    ]
    return Table(("model", *map(label, kinds)), tuple(rows), words=1)


def by_sequence(answers: Answers, kind: Case, measure: Measure) -> Table:
    """One measure in one kind of case: a row a model, a column a sequence; means over seeds ± deviation over the repeats."""
    rows = []
    for model in answers.ordered(kind, measure):
        found = answers.found(model, kind, measure)
        told = [spread(list(found.on(i).by_repeat), measure.digits) for i in range(len(answers.sequences))]
        rows.append((model, *told))
    return Table(("model", *answers.sequences), tuple(rows), words=1)


def stress(answers: Answers, named: Mapping[str, str]) -> Table:
    """As driven: a row a sequence and model; means over seeds ± deviation over them."""
    measures, rows = (RECALL, AUC, AUROC, FAR, FAR_AUROC), []
    for i, sequence in enumerate(answers.sequences):
        for model in answers.ordered(Case(), RECALL):
            found = [answers.found(model, Case(), measure).on(i) for measure in measures]
            told = [spread(list(one.by_seed), measure.digits) for one, measure in zip(found, measures, strict=True)]
            rows.append((named[sequence], model, str(len(answers.judged[model])), *told))
    header = ("sequence", "model", "seeds", *(measure.title for measure in measures))
    return Table(header, tuple(rows), words=2)


def over_sequences(found: Found, measure: Measure) -> str:
    """A mean and its deviation over the sequences."""
    return spread(list(found.by_sequence), measure.digits)
