"""One number of one model over its seeds, the test sequences and the repeats: means and
deviations."""

import numpy as np
from numpy.typing import NDArray


class Measurement:
    """One number of one model in one kind of case; means are of the finite values, NaN of none."""

    def __init__(self, values: NDArray[np.float64]) -> None:
        """Values (seed, sequence, repeat), NaN where there is none."""
        self.values = values
        repeat_means = _mean(values, 2)
        self.by_sequence = _mean(repeat_means, 0)  # (sequence,) means over repeats, then over seeds
        self.by_seed = _mean(repeat_means, 1)  # (seed,) means over repeats, then over sequences
        self.by_repeat = _mean(
            _mean(values, 0), 0
        )  # (repeat,) means over seeds, then over sequences
        self.mean = float(_mean(self.by_sequence, 0))
        # standard deviations, NaN of fewer than two: over the sequences; over the seeds of what
        # each has on average; over the repeats of one seed on one sequence, on average
        self.over_sequences = deviation(self.by_sequence)
        self.over_seeds = deviation(self.by_seed)
        self.over_repeats = float(
            _mean(np.ma.filled(np.ma.masked_invalid(values).std(axis=2, ddof=1), np.nan), None)
        )

    def on(self, sequence: int) -> "Measurement":
        """The same on one sequence alone."""
        return Measurement(self.values[:, sequence : sequence + 1])


def _mean(values: NDArray[np.float64], axis: int | None) -> NDArray[np.float64]:
    """Of the finite ones along an axis; NaN of none."""
    return np.asarray(np.ma.filled(np.ma.masked_invalid(values).mean(axis=axis), np.nan))


def deviation(values: NDArray[np.float64]) -> float:
    """Standard deviation of the finite ones; NaN of fewer than two."""
    finite = values[np.isfinite(values)]
    return float(finite.std(ddof=1)) if len(finite) > 1 else np.nan
