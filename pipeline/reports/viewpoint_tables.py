"""What paper 2's protocol gave, as tables: over the headings, over the seeds, and every heading."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.viewpoints import MEAN, NUMBERS, Judged
from pipeline.reports.learned import Learned
from pipeline.reports.table import MISSING, Table, mean, spread
from pipeline.reports.viewpoint_figures import means, values
from pipeline.reports.viewpoint_learning import COLLAPSE

Seeds = Mapping[tuple[str, str], Sequence[Judged]]
"""(method, sequence) to what was judged there, one a seed."""
TITLES = dict(zip(NUMBERS, ("ROC-AUC", "PR-AUC", "accuracy", "recall"), strict=True))


def over_headings(judged: Seeds) -> Table:
    """A row a sequence and method: numbers over the headings, and what a place costs; means over sequences at the end."""
    rows, methods = [], dict.fromkeys(method for method, _ in judged)
    sequences = list(dict.fromkeys(sequence for _, sequence in judged))
    for sequence in sequences:
        for method in methods:
            if seeds := judged.get((method, sequence)):
                found = {name: _mean_of_seeds(seeds, name) for name in NUMBERS}
                there = int(np.isfinite(found["roc_auc"]).sum())
                told = (spread(list(found[name]), 3) for name in NUMBERS)
                cost = f"{seeds[0].bytes_per_place:.0f}"
                rows.append(
                    (sequence, method, *told, f"{there} of {len(found['roc_auc'])}", str(int(seeds[0].valid.sum())), cost)
                )
    if len(sequences) > 1:
        for method in methods:
            means_of = [
                [mean(list(_mean_of_seeds(seeds, name))) for (one, _), seeds in judged.items() if one == method]
                for name in NUMBERS
            ]
            rows.append(("all, ± over sequences", method, *(spread(numbers, 3) for numbers in means_of), "", "", ""))
    header = ("sequence", "method", *TITLES.values(), "headings with ROC-AUC", "queries", "bytes a place")
    return Table(header, tuple(rows), words=2)


def over_seeds(judged: Seeds) -> Table | None:
    """A row a sequence and method of several seeds; None where there is none."""
    rows = [
        (sequence, method, str(len(seeds)), *(spread([one.numbers()[MEAN][name] for one in seeds], 3) for name in NUMBERS))
        for (method, sequence), seeds in judged.items()
        if len(seeds) > 1
    ]
    return Table(("sequence", "method", "seeds", *TITLES.values()), tuple(rows), words=2) if rows else None


def every_heading(judged: Seeds, name: str) -> Table:
    """One number, a column a heading; a row a sequence and method, mean over its seeds ± standard deviation."""
    first = next(iter(judged.values()))[0]
    rows = [
        (sequence, method, *(spread([values(one, name)[i] for one in seeds], 3) for i in range(len(first.headings_deg))))
        for (method, sequence), seeds in judged.items()
    ]
    return Table(("sequence", "method", *(f"{deg:g}°" for deg in first.headings_deg)), tuple(rows), words=2)


def after_learning(learned: Mapping[str, Sequence[Learned]]) -> Table | None:
    """A row a method that tells of collapse: what its curves say at the end."""
    rows = []
    for method, seeds in learned.items():
        if any(COLLAPSE.keys() & one.curves.keys() for one in seeds):
            told = [[_kept(one, name) for one in seeds] for name in COLLAPSE]
            rows.append((method, *(_significant(values) for values in told)))
    return Table(("method", *COLLAPSE.values()), tuple(rows), words=1) if rows else None


def _kept(model: Learned, name: str) -> float | None:
    """A curve at the round that was kept, else at the last."""
    if not len(curve := model.curves.get(name, np.empty(0))):
        return None
    return float(curve[-1 if model.best_round is None else model.best_round])


def _significant(found: Sequence[float | None]) -> str:
    """Mean and deviation with three digits that mean something, be a variance 0.0004 or 80."""
    size = mean(found)
    return MISSING if size is None else spread(found, max(0, 2 - int(np.floor(np.log10(max(abs(size), 1e-6))))))


def _mean_of_seeds(seeds: Sequence[Judged], name: str) -> NDArray[np.float64]:
    """At each heading (h,), NaN where no seed has it."""
    return means(np.stack([values(one, name) for one in seeds]))
