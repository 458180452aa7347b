"""Small evaluations and comparisons, worked out by hand, that the tests of figures draw."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.evaluation.bootstrap import Estimate
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.judge import judge
from pipeline.evaluation.protocols import PROTOCOLS, Distance
from pipeline.evaluation.rows import NOVELTY, case_columns, evaluation_rows, row, table
from pipeline.evaluation.viewpoint_matches import ViewpointMatches
from pipeline.perturbations import Case
from pipeline.report.comparison import MEASURES, Comparison, Kind
from pipeline.report.result import Result
from tests.evaluation.made import BOOTSTRAP, LABELS, SCI, XY_M, judged, standing

TRAIN_XY_M = np.stack([np.linspace(0, 100, 50), np.zeros(50)], axis=1)
TRAIN_PLACES = np.repeat(np.arange(10), 5)
"""Ten places of five submaps each, 2.04 m apart."""


def evaluation(
    days: int = 20,
    places: np.ndarray = LABELS.places,
    threshold: float = 0.5,
    wrong: Sequence[int] = (),
    heading_deg: float = np.nan,
    xy_m: np.ndarray = XY_M,
) -> Evaluation:
    """Seven queries at `xy_m`, the last two unseen, with the answers of SCI.

    Entropy ranks 9 of 10 pairs of seen and unseen right, energy all. The queries of `wrong` are
    placed 200 m off as well.
    """
    misplaced = list(wrong)
    answers_xy_m = SCI.xy_m + (xy_m - XY_M)[:, None]
    answers_xy_m[misplaced, 0, 0] = xy_m[misplaced, 0] + 200.0
    answered = SCI.places.copy()
    answered[misplaced, 0] = 9
    ranking = replace(
        SCI,
        places=answered,
        xy_m=answers_xy_m,
        heading_deg=np.full((7, 2), heading_deg, np.float32),
    )
    labels = replace(LABELS, places=places, days=days)
    return judge(ranking, (threshold, 6.0), labels, standing(xy_m), Distance(), BOOTSTRAP)


def result(model: str, sequence: str, days: int, one: Evaluation) -> Result:
    """A result whose numbers are those of the table of results."""
    rows = [each for each in evaluation_rows(one) if each["ask"] != NOVELTY]
    wanted = [row("target_precision", by, 0.9) for by in PROTOCOLS]
    return Result(model, sequence, days, table([*rows, *wanted]), one)


def rows_of(numbers: Mapping[tuple[str, str], Estimate]) -> pd.DataFrame:
    """The table of results with these numbers alone, given by protocol and name."""
    return table(row(name, protocol, *values) for (protocol, name), values in numbers.items())


def results(*models: str) -> list[Result]:
    return [
        result(model, date, days, evaluation(days))
        for model in models
        for date, days in (("2012-02-04", 20), ("2012-03-17", 62))
    ]


def bounded(one: Result, low: float, high: float) -> Result:
    """The results with another interval of all numbers."""
    return replace(one, rows=one.rows.assign(low=low, high=high))


ONE = results("sci")
BOTH = results("sci", "m2dp")
NOTHING = result(
    "sci", "2012-02-04", 20, evaluation(20, np.full(7, -1), float(np.finfo(np.float64).min))
)
"""A sequence that training never saw, and a threshold that accepts nothing."""


ERROR_M = np.array([0.1, 0.2, 50.0, 1.0, 0.3, np.nan, 80.0])
POSED = [
    replace(
        one,
        evaluation=replace(
            one.evaluation,
            pose_error_m=ERROR_M,
            pose_error_deg=np.where(ERROR_M > 2, 90, 0.5),
            reject_pose_from=0.35,
        ),
        rows=rows_of(one.numbers | {("distance", "pose_ece"): (0.364, np.nan, np.nan)}),
    )
    for one in ONE
]
"""Novelties .1 .8 .2 .3 .05 .4 .9: accepted are the first and the third to the fifth, of which the
third is wrong."""


def matched(*right: str) -> ViewpointMatches:
    """Four queries from each of some headings, of falling score, matched 1 m off or 80 m off.

    `right` has a 1 for each that is right: `1010` for a heading.
    """
    correct = np.array([[letter == "1" for letter in letters] for letters in right])
    return judged(correct, np.tile([4, 3, 2, 1], (len(right), 1)))


def compared(
    values: Mapping[tuple[str, Kind], Sequence[Sequence[Sequence[float]]]],
    n_way: Mapping[str, int],
    **own: float,
) -> Comparison:
    """Estimate (seed, sequence, repeat) by model and kind, the same of all numbers but those of
    `own`, the same everywhere."""
    rows = []
    for (model, kind), array in values.items():
        (method, _, variant) = model.partition("-")
        place = case_columns(Case(**vars(kind)))
        for (seed, sequence, repeat), value in np.ndenumerate(np.array(array)):
            where = {
                "method": method,
                "variant": variant,
                "seed": seed,
                "repeat": repeat,
                "sequence": DAYS[sequence],
            }
            for one in MEASURES:
                rows.append(
                    place
                    | where
                    | {"days": sequence}
                    | row(one.name, one.protocol, own.get(one.name, value))
                )
    return Comparison(table(rows), n_way)


DAYS = ("2012-02-04", "2012-06-15", "2012-10-28")
TURNED = Kind("turned")
COMPARED = compared(
    {
        ("sci", Kind()): [[[0.8], [0.8]]],
        ("sci", TURNED): [[[0.2, 0.2], [0.4, 0.4]]],
        ("sci-4way", Kind()): [[[0.7], [0.8]]],
        ("sci-4way", TURNED): [[[0.7, 0.7], [0.78, 0.78]]],
        ("sci_ring", Kind()): [[[0.9], [0.8]], [[0.9], [0.8]]],
        ("sci_ring", TURNED): [[[0.9, 0.9], [0.8, 0.76]], [[0.9, 0.8], [0.7, 0.74]]],
    },
    {"sci": 2, "sci-4way": 4},
)
BUILT = compared(
    {
        (model, Kind("construction" if level else "", level, shadow)): [[[auc], [auc]]]
        for model, aucs in (("sci", (0.8, 0.7, 0.6, 0.6, 0.3)), ("m2dp", (0.5,) * 5))
        for (level, shadow), auc in zip(
            ((0, False), (1, False), (2, False), (1, True), (2, True)), aucs, strict=True
        )
    },
    {},
)


def words(fig: Figure) -> list[str]:
    return [text.get_text() for text in fig.findobj(Text)]
