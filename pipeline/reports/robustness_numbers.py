"""The numbers of a study of robustness: a model's values over its seeds, the test sequences and the repeats."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case


@dataclass(frozen=True)
class Measure:
    """A number of an evaluation, or what is left of it once the queries are altered."""

    protocol: str
    name: str
    title: str
    digits: int = 3
    relative: bool = False
    """As a share of the same model's, of the same seed and sequence, as driven."""


AUC = Measure("cells", "auc_top1", "AUC top-1 by cells")
KEPT = replace(AUC, title="AUC kept, by cells", relative=True)
RECALL = Measure("cells", "recall_at_1", "recall@1 by cells")
AUROC = Measure("cells", "auroc", "AUROC by cells")
FAR_AUC = Measure("distance", "auc_top1", "AUC top-1 by distance")
FAR = Measure("distance", "recall_at_1", "recall@1 by distance")
FAR_AUROC = Measure("distance", "auroc", "AUROC by distance")
OFF = Measure("distance", "median_heading_error_deg", "heading error [°]", 1)
WITHIN = Measure("distance", "heading_within_10deg", "within 10°")


@dataclass(frozen=True)
class Found:
    """One number of one model in one kind of case."""

    values: NDArray[np.float64]
    """(seed, sequence, repeat), NaN where there is none."""

    @property
    def mean(self) -> float:
        """Over all of them; NaN of none."""
        return float(np.ma.filled(_masked(self.by_sequence).mean(), np.nan))

    @property
    def by_sequence(self) -> NDArray[np.float64]:
        """(sequence,) means over repeats, then over seeds."""
        return _mean(_mean(self.values, 2), 0)

    @property
    def by_seed(self) -> NDArray[np.float64]:
        """(seed,) means over repeats, then over sequences."""
        return _mean(_mean(self.values, 2), 1)

    @property
    def by_repeat(self) -> NDArray[np.float64]:
        """(repeat,) means over seeds, then over sequences."""
        return _mean(_mean(self.values, 0), 0)

    def on(self, sequence: int) -> "Found":
        """The same on one sequence alone."""
        return Found(self.values[:, sequence : sequence + 1])

    @property
    def over_sequences(self) -> float:
        """Standard deviation over the sequences; NaN of fewer than two."""
        return deviation(self.by_sequence)

    @property
    def over_seeds(self) -> float:
        """Standard deviation over the seeds of what each has on average; NaN of fewer than two."""
        return deviation(self.by_seed)

    @property
    def over_repeats(self) -> float:
        """Standard deviation over the repeats of one seed on one sequence, on average; NaN of fewer than two."""
        apart = np.ma.filled(_masked(self.values).std(axis=2, ddof=1), np.nan)
        return float(np.ma.filled(_masked(apart).mean(), np.nan))


@dataclass(frozen=True)
class Margin:
    """By how much one model is ahead of another on the same sequences and repeats, in means over seeds."""

    value: float
    over_sequences: float
    number: int
    clear: bool
    """Ahead, or behind, on every one of several sequences, and by more than the deviation over them and over either's seeds,
    or, of one seed, than another might differ by."""


def label(kind: Case) -> str:
    """A kind of case in words."""
    if kind.change == "demolition":
        return f"{kind.level:g}° removed"
    if kind.change == "construction":
        walls = "1 wall" if kind.level == 1 else f"{kind.level:g} walls"
        return f"{walls}, shadow" if kind.shadow else walls
    return kind.change


def _masked(values: NDArray[np.float64]) -> "np.ma.MaskedArray[tuple[int, ...], np.dtype[np.float64]]":
    return np.ma.masked_invalid(values)


def _mean(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return np.asarray(np.ma.filled(_masked(values).mean(axis=axis), np.nan))


def deviation(values: NDArray[np.float64]) -> float:
    """Standard deviation of those that are there; NaN of fewer than two."""
    there = values[np.isfinite(values)]
    return float(there.std(ddof=1)) if len(there) > 1 else np.nan
