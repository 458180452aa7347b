"""How a metric changes with the days since training, and when training again is due.

In: one value for each test sequence, and the days from training to it. Out: a straight line through
the values by least squares, the interval of its slope, and the day on which a tenth of the value on
day 0 is lost. The interval comes from the scatter of the sequences about the line, whatever its
cause: noise along each path, another share of streets driven backwards, the weather of the day.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit  # scipy.stats alone takes half a second to import

from pipeline.core.settings import InnerShare, checked
from pipeline.evaluation.bootstrap import Estimate
from pipeline.evaluation.evaluations import Evaluation

TINY = 1e-150
"""Stands in for a standard error of zero, which values on one line have."""


@dataclass(frozen=True)
class Line:
    """A value v = intercept + slope · days, fitted to `sequence_count` sequences."""

    sequence_count: int
    intercept: float
    """The value on the day of training."""
    slope: float
    """The change of the value in a day."""
    middle_slope: float
    """The slope by Theil and Sen: the median over all pairs of sequences on different days, which
    one odd sequence hardly moves."""
    p: float
    """Two-sided p value of the hypothesis that the slope is 0; NaN with two sequences."""
    quantile: float
    """The half width of intervals in standard errors: the quantile of Student's t with
    sequence_count − 2 degrees of freedom. NaN with two sequences, which leave none."""
    covariance: NDArray[np.float64]
    """(2, 2) covariance of intercept and slope."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lowest and highest slope; None with two sequences, which a line always fits."""
        half_width = self.quantile * np.sqrt(self.covariance[1, 1])
        if np.isnan(half_width):
            return None
        return float(self.slope - half_width), float(self.slope + half_width)

    @property
    def trend(self) -> int:
        """−1 if the whole interval of the slope lies below 0, +1 if above, else 0."""
        if self.interval is None:
            return 0
        low, high = self.interval
        return int(low > 0) - int(high < 0)

    def at(self, days: NDArray[Any]) -> NDArray[np.float64]:
        """The line's value with its lowest and highest (3, n) on days (n,), each day by itself.

        The bounds are NaN if there is no interval.
        """
        design = np.stack([np.ones_like(days, np.float64), days])
        value = np.array([self.intercept, self.slope]) @ design
        variance = np.einsum("in,ij,jn->n", design, self.covariance, design)
        half_width = self.quantile * np.sqrt(variance)
        return np.stack([value, value - half_width, value + half_width])

    def lost(self, share: float) -> Estimate | None:
        """The day on which `share` of the value on day 0 is lost, and its earliest and latest.

        None unless the whole interval of the slope is below 0. The interval of the day is Fieller's
        (1954), of a ratio: it holds the days d on which share · intercept + slope · d = 0 cannot be
        ruled out. So it allows for the uncertainty of the intercept too.
        """
        if self.trend >= 0 or self.intercept <= 0:
            return None
        day = float(-share * self.intercept / self.slope)
        # The bounds are the roots of a quadratic, bb · d² + 2 share · ab · d + share² · aa = 0.
        estimate = np.array([self.intercept, self.slope])
        (aa, ab), (_, bb) = np.outer(estimate, estimate) - self.quantile**2 * self.covariance
        root = np.sqrt(max(ab**2 - aa * bb, 0.0))
        earliest = max(0.0, float(share * (-ab - root) / bb))
        latest = max(0.0, float(share * (-ab + root) / bb))
        return Estimate(day, earliest, latest)


@dataclass(frozen=True)
@checked("ageing")
class Ageing:
    """Settings of the lines over the days (conf/results.yaml)."""

    loss: InnerShare = 0.1
    """Training again is due once this fraction of a metric's value on day 0 is lost."""
    level: InnerShare = 0.95
    """Confidence level of the intervals."""

    def line(self, days: NDArray[Any], values: NDArray[Any]) -> Line | None:
        """Fit a line to values (n,) on days (n,) since training, leaving out values that are NaN.

        None unless two values lie on different days.
        """
        is_defined = np.isfinite(values)
        x = np.asarray(days, np.float64)[is_defined]
        y = np.asarray(values, np.float64)[is_defined]
        if len(np.unique(x)) < 2:
            return None
        n = len(x)
        x_centred = x - x.mean()
        y_centred = y - y.mean()
        x_squares = x_centred @ x_centred
        slope = float(x_centred @ y_centred / x_squares)
        residuals = y_centred - slope * x_centred
        slope_variance = p = quantile = np.nan
        if n > 2:
            slope_variance = (residuals @ residuals) / x_squares / (n - 2)
            t = abs(slope) / max(np.sqrt(slope_variance), TINY)
            p = float(2 * stdtr(n - 2, -t))
            quantile = float(stdtrit(n - 2, (1 + self.level) / 2))
        # Both parts of mean(y) − slope · mean(x) are independent: σ²/n + mean(x)² · slope_variance.
        intercept_variance = slope_variance * (x**2).mean()
        covariance = -slope_variance * x.mean()
        earlier, later = np.nonzero(x[:, None] < x)  # all pairs on different days
        pair_slopes = (y[later] - y[earlier]) / (x[later] - x[earlier])
        return Line(
            sequence_count=n,
            intercept=float(y.mean() - slope * x.mean()),
            slope=slope,
            middle_slope=float(np.median(pair_slopes)),
            p=p,
            quantile=quantile,
            covariance=np.array([[intercept_variance, covariance], [covariance, slope_variance]]),
        )


def newness(evaluation: Evaluation, validation: NDArray[np.float64]) -> float:
    """How new the seen queries look, as a percentile: 50 is as new as on the day of training.

    It is the percentile of their median novelty among `validation` (h,), the novelties of
    validation queries of training. Queries are seen by distance. NaN if either has no query.
    """
    seen = evaluation.novelty[evaluation.distance.seen, 0]
    if not len(seen) or not len(validation):
        return np.nan
    median = np.median(seen)
    # the mean of both fractions, so that equal novelties count half
    return float(50 * ((validation < median).mean() + (validation <= median).mean()))
