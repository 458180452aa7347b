"""How a number changes with the days since training, and when training again is due.

A straight line through one value a test sequence, by least squares. Its interval is of the scatter
of the sequences about the line, whatever that comes from: chance along each path, another share of
streets driven backwards, the weather of the day.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit  # scipy.stats alone takes half a second to import

from pipeline.core.settings import InnerShare, check
from pipeline.evaluation.judgement import Evaluation

TINY = 1e-150
"""In place of a standard error of zero, of values that are all equal."""


@dataclass(frozen=True)
class Line:
    """A value v = intercept + slope · days, fitted to `number` sequences."""

    number: int
    last_day: float
    """Of the last sequence: what lies after it is extrapolated."""
    intercept: float
    """On the day of training."""
    slope: float
    """A day."""
    middle_slope: float
    """Theil and Sen's: the median over all pairs of unlike days, which one odd sequence hardly
    moves."""
    p: float
    """Two-sided, of no slope; NaN of two sequences."""
    quantile: float
    """Of Student's t with number − 2 degrees of freedom; NaN of two sequences, which leave none."""
    covariance: NDArray[np.float64]
    """(2, 2) of intercept and slope."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lowest and highest slope a day; None of two sequences, which a line always fits."""
        half = self.quantile * np.sqrt(self.covariance[1, 1])
        return None if np.isnan(half) else (float(self.slope - half), float(self.slope + half))

    @property
    def trend(self) -> int:
        """−1 and +1 where the whole interval of the slope lies below and above 0, else 0."""
        low, high = self.interval or (-1.0, 1.0)
        return int(low > 0) - int(high < 0)

    def at(self, days: NDArray[Any]) -> NDArray[np.float64]:
        """The line's value with its lowest and highest (3, n) on days (n,), each day by itself.

        NaN bounds where there is no interval.
        """
        design = np.stack([np.ones_like(days, np.float64), days])
        value = np.array([self.intercept, self.slope]) @ design
        half = self.quantile * np.sqrt(np.einsum("in,ij,jn->n", design, self.covariance, design))
        return np.stack([value, value - half, value + half])

    def lost(self, share: float) -> tuple[float, float, float] | None:
        """The day on which `share` of the value on day 0 is lost, and its earliest and latest.

        None unless the line surely falls. Fieller's interval of a ratio (1954): the days d on which
        share · intercept + slope · d = 0 cannot be ruled out; unlike the slope's interval alone, it
        knows that the intercept is uncertain too.
        """
        if self.trend >= 0 or self.intercept <= 0:
            return None
        estimate = np.array([self.intercept, self.slope])
        (aa, ab), (_, bb) = np.outer(estimate, estimate) - self.quantile**2 * self.covariance
        half = np.sqrt(max(ab**2 - aa * bb, 0.0))
        earliest, latest = (max(0.0, float(share * (-ab + sign * half) / bb)) for sign in (-1, 1))
        return float(-share * self.intercept / self.slope), earliest, latest


@dataclass(frozen=True)
class Ageing:
    """Settings of the lines over the days (conf/results.yaml)."""

    loss: InnerShare = 0.1
    """The share of a number's value on the day of training whose loss calls for training again."""
    level: InnerShare = 0.95
    """Of the intervals."""

    def __post_init__(self) -> None:
        check(self, "ageing")

    def line(self, days: NDArray[Any], values: NDArray[Any]) -> Line | None:
        """Fit a line to values (n,) on days (n,) since training, leaving out values that are NaN.

        None unless two values lie on unlike days.
        """
        defined = np.isfinite(values)
        x = np.asarray(days, np.float64)[defined]
        y = np.asarray(values, np.float64)[defined]
        if len(np.unique(x)) < 2:
            return None
        n = len(x)
        x_centred = x - x.mean()
        y_centred = y - y.mean()
        x_squares = x_centred @ x_centred
        slope = float(x_centred @ y_centred / x_squares)
        residuals = y_centred - slope * x_centred
        slope_variance = (residuals @ residuals) / x_squares / (n - 2) if n > 2 else np.nan
        intercept_variance = slope_variance * (x**2).mean()
        covariance = -slope_variance * x.mean()
        before, after = np.nonzero(x[:, None] < x)
        return Line(
            number=n,
            last_day=float(x.max()),
            intercept=float(y.mean() - slope * x.mean()),
            slope=slope,
            middle_slope=float(np.median((y[after] - y[before]) / (x[after] - x[before]))),
            p=float(2 * stdtr(n - 2, -abs(slope) / max(np.sqrt(slope_variance), TINY)))
            if n > 2
            else np.nan,
            quantile=float(stdtrit(n - 2, (1 + self.level) / 2)) if n > 2 else np.nan,
            covariance=np.array([[intercept_variance, covariance], [covariance, slope_variance]]),
        )


def newness(evaluation: Evaluation, held_out: NDArray[np.float64]) -> float:
    """How new the seen queries look: percentile of their median novelty on held-out queries.

    `held_out` (h,) is the novelty of those. Seen by distance, novelty in use; 50 is as new as the
    day of training itself. NaN where either is empty.
    """
    seen = evaluation.novelty[evaluation.distance.seen, 0]
    if not len(seen) or not len(held_out):
        return np.nan
    return float(50 * ((held_out < np.median(seen)).mean() + (held_out <= np.median(seen)).mean()))
