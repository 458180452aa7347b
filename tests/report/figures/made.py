"""Small evaluations and comparisons, worked out by hand, that the tests of figures draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.judgement import Evaluation, judge
from pipeline.evaluation.numbers import numbers
from pipeline.evaluation.protocols import Distance
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Ranking
from pipeline.report.comparison import Found, Kind, Measure

TRAIN_XY_M = np.stack([np.linspace(0, 100, 50), np.zeros(50)], axis=1)
TRAIN_PLACES = np.repeat(np.arange(10), 5)
"""Ten places of five submaps each, 2.04 m apart."""


def evaluation(days: int = 20) -> Evaluation:
    """Seven queries, the last two unseen, with two kinds of novelty.

    By cells: hit, miss, false alarm (200 m off), false alarm (next cell, 6 m off), hit (turned around), false alarm (unseen),
    correct rejection; by distance the fourth is a hit. Entropy ranks 9 of 10 pairs of seen and unseen right, energy all.
    """
    xy_m = np.array([(0, 0), (10, 0), (20, 0), (30, 0), (40, 0), (40, 100), (40, 120)], float)
    answers_xy_m = np.stack([xy_m + np.array([off, 0.0]) for off in (1.0, 300.0)], axis=1)
    answers_xy_m[2, 0, 0] = xy_m[2, 0] + 200.0
    answers_xy_m[3, 0, 0] = xy_m[3, 0] + 6.0
    cost = np.array([0.05, 0.75, 0.15, 0.25, 0.05, 0.45, 0.95], np.float32)
    ranking = Ranking(
        places=np.array([[1, 2], [2, 3], [9, 3], [5, 4], [5, 1], [1, 2], [1, 2]]),
        costs=np.stack([cost, np.ones_like(cost)], axis=1),
        xy_m=answers_xy_m,
        novelty=np.array([[0.1, 1], [0.8, 2], [0.2, 3], [0.3, 4], [0.05, 5], [0.4, 8], [0.9, 9]], np.float32),
        confidence=1 - cost / 2,
        heading_deg=np.full(7, np.nan, np.float32),
        kinds=("entropy", "energy"),
    )
    labels = Labels(
        places=np.array([1, 2, 3, 4, 5, -1, -1]),
        cells=np.arange(10),
        oracle=np.array([1, 2, 3, 5, 5, 5, 5]),
        nearest_m=np.array([1.0, 1.0, 1.0, 1.0, 1.0, 100.0, 120.0]),
        nearest_turn_deg=np.array([0.0, 0.0, 0.0, 0.0, 179.0, 0.0, 0.0]),
    )
    world_T_anchor = np.tile(np.eye(4), (7, 1, 1))
    world_T_anchor[:, :2, 3] = xy_m
    return judge(ranking, (0.5, 6.0), labels, world_T_anchor, days, Distance(), Bootstrap(block_m=15.0, resamples=40))


@dataclass(frozen=True)
class Given:
    """What figures use of a Result, with some numbers replaced."""

    model: str
    sequence: str
    days: int
    evaluation: Evaluation
    bounds: tuple[float, float] | None = None
    wanted_precision: float = 0.9

    @property
    def label(self) -> str:
        return f"{self.sequence}, {self.days:+d} d"

    def number(self, protocol: str, name: str) -> float:
        e = self.evaluation
        return float(numbers(e.truth(protocol), e.queries, np.ones((1, len(e.answer))))[name][0])

    def interval(self, protocol: str, name: str) -> tuple[float, float] | None:
        return self.bounds


def results(*models: str) -> list[Any]:
    return [
        Given(model, date, days, evaluation(days)) for model in models for date, days in (("2012-02-04", 20), ("2012-03-17", 62))
    ]


ONE = results("sci")
BOTH = results("sci", "m2dp")
E = ONE[0].evaluation
UNSEEN = replace(E.cells, recall_at=np.full(25, np.nan), seen=np.zeros(7, bool), oracle_right=np.zeros(7, bool))
NOTHING = replace(ONE[0], evaluation=replace(E, reject_from=(float(np.finfo(np.float64).min), 0.0), cells=UNSEEN))
"""A sequence that training never saw, and a threshold that accepts nothing."""


@dataclass(frozen=True)
class Numbers:
    """What figures use of a Comparison: values (seed, sequence, repeat) of all measures by model and kind."""

    values: Mapping[tuple[str, Kind], Sequence[Sequence[Sequence[float]]]]
    sequences: tuple[str, ...] = ("2012-02-04", "2012-06-15")

    @property
    def models(self) -> list[str]:
        return list(dict.fromkeys(model for model, _ in self.values))

    @property
    def kinds(self) -> list[Kind]:
        return list(dict.fromkeys(kind for _, kind in self.values))

    @property
    def changes(self) -> list[Kind]:
        return self.kinds[1:]

    def found(self, model: str, kind: Kind, measure: Measure) -> Found:
        whole = np.array(self.values[model, Kind()])[:, :, :1] if measure.relative else 1.0
        return Found(np.array(self.values[model, kind]) / whole)

    def ordered(self, kind: Kind, measure: Measure) -> list[str]:
        return sorted(self.models, key=lambda model: -self.found(model, kind, measure).mean)

    def ways(self) -> dict[int, str]:
        return {2: "sci", 4: "sci-4way"}


TURNED = Kind("turned")
COMPARED: Any = Numbers(
    {
        ("sci", Kind()): [[[0.8], [0.8]]],
        ("sci", TURNED): [[[0.2, 0.2], [0.4, 0.4]]],
        ("sci-4way", Kind()): [[[0.7], [0.8]]],
        ("sci-4way", TURNED): [[[0.7, 0.7], [0.78, 0.78]]],
        ("sci_ring", Kind()): [[[0.9], [0.8]], [[0.9], [0.8]]],
        ("sci_ring", TURNED): [[[0.9, 0.9], [0.8, 0.76]], [[0.9, 0.8], [0.7, 0.74]]],
    }
)
BUILT: Any = Numbers(
    {
        (model, Kind("construction" if level else "", level, shadow)): [[[auc], [auc]]]
        for model, aucs in (("sci", (0.8, 0.7, 0.6, 0.6, 0.3)), ("m2dp", (0.5,) * 5))
        for (level, shadow), auc in zip(((0, False), (1, False), (2, False), (1, True), (2, True)), aucs, strict=True)
    }
)


def words(fig: Figure) -> list[str]:
    return [text.get_text() for text in fig.findobj(Text)]
