"""How steady a model is over the days if it keeps one threshold: AwC-FT.

In: a model's evaluations of unperturbed queries on several days. Out: the area between the best and
the worst day's F1 score over the threshold, by Ma and others ("Evaluation of Range Sensing-based
Place Recognition for Long-term Urban Localization", IEEE T-IV 2024; METHODS 2.7). Lower is
steadier.
"""

from collections.abc import Iterable

import numpy as np

from pipeline.evaluation.curves import f1
from pipeline.evaluation.evaluations import Evaluation

AWC_FT = "awc_ft"
"""The number's name in the table of results."""


def awc_ft(evaluations: Iterable[Evaluation], protocol: str) -> float:
    """The mean gap between the best and the worst day's F1 as the threshold rises evenly, 0 to 1.

    The threshold runs from the smallest to the largest finite novelty in use, of all days together.
    NaN unless two days have a seen query, and if all novelties are equal.
    """
    days = [one for one in evaluations if one.protocol(protocol).seen.any()]
    if len(days) < 2:
        return np.nan
    novelty = np.unique(np.concatenate([day.novelty[:, 0] for day in days]).astype(np.float64))
    novelty = novelty[np.isfinite(novelty)]
    if len(novelty) < 2:
        return np.nan
    # All thresholds above one novelty, up to the next one, accept the same queries: the curves are
    # steps, and so this area is exact.
    steps = np.diff(novelty)
    by_day = np.array([f1(*day.curve(protocol, novelty[1:])) for day in days])
    return float(np.ptp(by_day, axis=0) @ steps / steps.sum())
