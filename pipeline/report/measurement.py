"""One number of one model over seeds, test sequences and repeats: means and standard deviations."""

import numpy as np
from numpy.typing import NDArray


class Measurement:
    """One number of one model in one kind of case, over seeds, sequences and repeats.

    Means are of the finite values, NaN where there is none.
    """

    def __init__(self, values: NDArray[np.float64]) -> None:
        """Take values (seed, sequence, repeat), NaN where there is none."""
        self.values = values
        repeat_means = _mean(values, 2)
        self.by_sequence = _mean(repeat_means, 0)  # (sequence,) means over repeats, then over seeds
        self.by_seed = _mean(repeat_means, 1)  # (seed,) means over repeats, then over sequences
        seed_means = _mean(values, 0)
        self.by_repeat = _mean(seed_means, 0)  # (repeat,) means over seeds, then over sequences
        self.mean = float(_mean(self.by_sequence, 0))
        # standard deviations, NaN of fewer than two: over the sequences; over the seeds of what
        # each has on average; over the repeats of one seed on one sequence, on average
        self.over_sequences = deviation(self.by_sequence)
        self.over_seeds = deviation(self.by_seed)
        self.over_repeats = float(
            _mean(np.ma.filled(np.ma.masked_invalid(values).std(axis=2, ddof=1), np.nan), None)
        )

    def on(self, sequence: int) -> "Measurement":
        """The measurement on one sequence alone, given by its index."""
        return Measurement(self.values[:, sequence : sequence + 1])


def _mean(values: NDArray[np.float64], axis: int | None) -> NDArray[np.float64]:
    """Mean of the finite values along an axis; NaN where there is none."""
    return np.asarray(np.ma.filled(np.ma.masked_invalid(values).mean(axis=axis), np.nan))


def deviation(values: NDArray[np.float64]) -> float:
    """Standard deviation of the finite values; NaN for fewer than two."""
    finite = values[np.isfinite(values)]
    return float(finite.std(ddof=1)) if len(finite) > 1 else np.nan
