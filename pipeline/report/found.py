"""One number of one model over its seeds, the test sequences and the repeats: means and deviations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Found:
    """One number of one model in one kind of case."""

    values: NDArray[np.float64]
    """(seed, sequence, repeat), NaN where there is none."""

    @property
    def mean(self) -> float:
        """Over all of them; NaN of none."""
        return float(mean(self.by_sequence, 0))

    @property
    def by_sequence(self) -> NDArray[np.float64]:
        """(sequence,) means over repeats, then over seeds."""
        return mean(mean(self.values, 2), 0)

    @property
    def by_seed(self) -> NDArray[np.float64]:
        """(seed,) means over repeats, then over sequences."""
        return mean(mean(self.values, 2), 1)

    @property
    def by_repeat(self) -> NDArray[np.float64]:
        """(repeat,) means over seeds, then over sequences."""
        return mean(mean(self.values, 0), 0)

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
        apart = np.ma.masked_invalid(self.values).std(axis=2, ddof=1)
        return float(np.ma.filled(np.ma.masked_invalid(np.ma.filled(apart, np.nan)).mean(), np.nan))


def mean(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Of the finite ones along an axis; NaN of none."""
    return np.asarray(np.ma.filled(np.ma.masked_invalid(values).mean(axis=axis), np.nan))


def deviation(values: Sequence[float] | NDArray[np.float64]) -> float:
    """Standard deviation of the finite ones; NaN of fewer than two."""
    there = np.asarray(values)[np.isfinite(values)]
    return float(there.std(ddof=1)) if len(there) > 1 else np.nan
