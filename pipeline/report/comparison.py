"""Compares models on perturbed queries and on stress sequences.

In: rows of the table of results. Out: a `Comparison`, which gives the `Measurement` of any model,
kind of queries and measure over sequences, seeds and repeats, orders models by it, and says by how
much one is ahead of another. Figures, tables and findings of a study of robustness are made of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.numbers import average, deviation
from pipeline.evaluation.rows import PERTURBED, STRESS, UNPERTURBED, WITH_SHADOW
from pipeline.studies.colours import method_of

# Assumed standard deviation over seeds for a model with one seed. Where there are three seeds (SCI
# and its ring, means over a simulated year) it is .003 to .016.
ONE_SEED = 0.02
# The columns that say which metric a row holds, of which model and kind of queries (`case`), and
# which of its repetitions.
NUMBER = ["model", "case", "protocol", "number"]
REPETITION = ["seed", "sequence", "repeat"]


@dataclass(frozen=True)
class Kind:
    """A kind of queries: what was done to them. Its repeats are taken together."""

    change: str = ""  # a perturbation, such as `turned`; empty for unperturbed queries
    level: float = 0.0  # degrees removed, or the number of new walls
    shadow: bool = False  # whether new walls hide what is behind them

    @classmethod
    def of_row(cls, ask: str, of: str, at: float) -> "Kind":
        """The kind of the queries that a row of the table of results is of."""
        if ask != PERTURBED:
            return cls()
        return cls(of.removesuffix(WITH_SHADOW), at, of.endswith(WITH_SHADOW))

    @property
    def label(self) -> str:
        """A word or two for legends: `unperturbed`, `60° removed`."""
        if self.change == "demolition":
            return f"{self.level:g}° removed"
        if self.change == "construction":
            walls = "1 new wall" if self.level == 1 else f"{self.level:g} new walls"
            return f"{walls} and shadow" if self.shadow else walls
        return self.change or "unperturbed"

    @property
    def clause(self) -> str:
        """A part of a sentence: `with 60° removed`, `turned`."""
        has_noun = self.change in ("demolition", "construction")
        return f"with {self.label}" if has_noun else self.label


UNPERTURBED_KIND = Kind()
"""The kind of unperturbed queries, which perturbed ones are compared with."""


@dataclass(frozen=True)
class Measure:
    """A metric of the table of results, or the fraction of it that perturbed queries keep."""

    protocol: str
    name: str
    title: str
    digits: int = 3
    # whether it is the fraction of what the same model and seed has on unperturbed queries of the
    # same sequence
    relative: bool = False


AUC = Measure("cells", "auc_top1", "AUC top-1 by cells")
AUC_5 = Measure("cells", "auc_top5", "AUC top-5 by cells")
AUC_25 = Measure("cells", "auc_top25", "AUC top-25 by cells")
AUC_SHARE = replace(AUC, title="AUC kept, by cells", relative=True)
RECALL = Measure("cells", "recall_at_1", "recall@1 by cells")
AUROC = Measure("cells", "auroc", "AUROC by cells")
AUC_BY_DISTANCE = Measure("distance", "auc_top1", "AUC top-1 by distance")
RECALL_BY_DISTANCE = Measure("distance", "recall_at_1", "recall@1 by distance")
AUROC_BY_DISTANCE = Measure("distance", "auroc", "AUROC by distance")
HEADING_ERROR = Measure("distance", "median_heading_error_deg", "heading error [°]", 1)
WITHIN = Measure("distance", "heading_within_10deg", "within 10°")
# What a `Comparison` holds; figures read AUC_5 and AUC_25 from the scores themselves.
MEASURES = (
    AUC,
    RECALL,
    AUROC,
    AUC_BY_DISTANCE,
    RECALL_BY_DISTANCE,
    AUROC_BY_DISTANCE,
    HEADING_ERROR,
    WITHIN,
)


class Measurement:
    """One measure of one model on one kind of queries, over seeds, sequences and repeats.

    Means are of the finite values, and NaN where there is none. Standard deviations are NaN for
    fewer than two values.
    """

    def __init__(self, values: NDArray[np.float64]) -> None:
        """Take values (seed, sequence, repeat), NaN where there is none."""
        self.values = values
        repeat_means = average(values, 2)
        # (sequence,) means over repeats, then over seeds
        self.by_sequence = average(repeat_means, 0)
        self.by_seed = average(repeat_means, 1)  # (seed,) means over repeats, then over sequences
        self.by_repeat = average(average(values, 0), 0)  # (repeat,) over seeds, then over sequences
        self.mean = float(average(self.by_sequence, 0))
        self.over_sequences = deviation(self.by_sequence)
        self.over_seeds = deviation(self.by_seed)
        # the standard deviation over the repeats of one seed on one sequence, on average
        self.over_repeats = float(average(np.apply_along_axis(deviation, 2, values)))

    def on(self, sequence: int) -> "Measurement":
        """The measurement on one sequence alone, given by its index."""
        return Measurement(self.values[:, sequence : sequence + 1])


@dataclass(frozen=True)
class Margin:
    """By how much one model is ahead of another on the same sequences and repeats.

    It is a difference of means over seeds. A margin is clear if it has one sign on several
    sequences and is larger than the standard deviation over them, and over the seeds of either
    model (ONE_SEED for one seed).
    """

    value: float
    number: int  # of sequences compared
    clear: bool


class Comparison:
    """Compares models on the rows of some sequences and cases."""

    def __init__(self, table: pd.DataFrame, n_way: Mapping[str, int]) -> None:
        """Take rows of the table of results.

        `n_way` maps a model to N if it was trained with N rotated copies of each scan. Raises
        InputError for no rows.
        """
        if table.empty:
            raise InputError("a comparison needs at least one row of the table of results")
        is_measure = table["number"].isin({measure.name for measure in MEASURES})
        rows = table[is_measure & table["ask"].isin([UNPERTURBED, STRESS, PERTURBED])]
        kind_columns = rows[["ask", "of", "at"]].itertuples(index=False)
        rows = rows.assign(case=[Kind.of_row(*columns) for columns in kind_columns])
        self.models = [*rows["model"].unique()]  # methods and variants, in the order they come
        # unperturbed comes first
        self.kinds = sorted(rows["case"].unique(), key=lambda kind: kind.change != "")
        self.changes = [kind for kind in self.kinds if kind.change]
        self.sequences = [*rows.sort_values(["days", "sequence"])["sequence"].unique()]
        # model to its number of seeds
        self.seeds: dict[str, int] = (rows.groupby("model")["seed"].max() + 1).to_dict()
        self.repeats = int(rows["repeat"].max()) + 1  # of the kind of case that has most
        self._n_way = n_way
        # one row per model, kind and number; one column per seed, sequence and repeat
        wide = rows.pivot(index=NUMBER, columns=REPETITION, values="value")
        axes = (range(max(self.seeds.values())), self.sequences, range(self.repeats))
        values = wide.reindex(columns=pd.MultiIndex.from_product(axes)).to_numpy(np.float64)
        shape = tuple(map(len, axes))
        self._values = dict(zip(wide.index, values.reshape(-1, *shape), strict=True))
        self._no_values = np.full(shape, np.nan)

    def ways(self) -> dict[int, str]:
        """For the method with the most N-way models: its models by N, in ascending order.

        N is the number of rotated copies of each training scan.
        """
        models_by_method: dict[str, dict[int, str]] = {}
        for model in self.models:
            if model in self._n_way:
                models_by_method.setdefault(method_of(model), {})[self._n_way[model]] = model
        most_models = max(models_by_method.values(), key=len, default={})
        return dict(sorted(most_models.items()))

    def measurement(self, model: str, kind: Kind, measure: Measure) -> Measurement:
        """One measure of one model on one kind of queries, over seeds, sequences and repeats."""
        number = (model, kind, measure.protocol, measure.name)
        values = self._values.get(number, self._no_values)[: self.seeds[model]]
        if not measure.relative:
            return Measurement(values)
        absolute = replace(measure, relative=False)
        unperturbed = self.measurement(model, UNPERTURBED_KIND, absolute).values[:, :, :1]
        return Measurement(values / np.where(unperturbed > 0, unperturbed, np.nan))

    def ordered(self, kind: Kind, measure: Measure) -> list[str]:
        """The models, from the largest mean to the smallest; models without a number come last."""
        means = {model: self.measurement(model, kind, measure).mean for model in self.models}
        return sorted(self.models, key=lambda model: -np.nan_to_num(means[model], nan=-np.inf))

    def ahead(self, model: str, reference: str, kind: Kind, measure: Measure) -> Margin:
        """By how much a model is ahead of a reference."""
        both = [self.measurement(name, kind, measure) for name in (model, reference)]
        differences = both[0].by_sequence - both[1].by_sequence
        differences = differences[np.isfinite(differences)]
        if not len(differences):
            return Margin(np.nan, 0, False)
        value = float(differences.mean())
        over_seeds = [np.nan_to_num(measurement.over_seeds, nan=ONE_SEED) for measurement in both]
        noise = np.nanmax([deviation(differences), *over_seeds])
        same_sign = bool((differences > 0).all() or (differences < 0).all())
        clear = len(differences) > 1 and same_sign and abs(value) > noise
        return Margin(value, len(differences), clear)
