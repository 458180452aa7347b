"""Line charts of the page as SVG: one line a model, with its name at the end of the line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

WIDE = 560.0  # px; the page scales it
LEFT = 58.0
RIGHT = 172.0
TOP = 14.0
BOTTOM = 34.0
APART = 14.0  # between the names at the ends of lines
BEST = "best"
NEXT = "next"
OTHER = "other"


@dataclass(frozen=True)
class Series:
    """One model's values over x; values that are not finite are left out."""

    model: str
    x: Sequence[float]
    y: Sequence[float]
    bounds: Sequence[tuple[float, float]] = ()  # the 95 % interval of each, of the best alone
    dots: Sequence[tuple[float, float, str]] = ()  # marks on the line, and what each says
    opens: Sequence[str] = ()  # the test day that the map shows for each dot


@dataclass(frozen=True)
class Line:
    """One model's line in px; `name_y` is the height of the model's name."""

    model: str
    role: str
    path: str
    band: str
    dots: Sequence[tuple[float, float, str, str]]
    end: tuple[float, float]
    name_y: float = 0.0


@dataclass(frozen=True)
class Chart:
    """Lines, the best model's last so that it lies on top, and the ticks of both axes."""

    lines: Sequence[Line]
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    high: float

    @property
    def size(self) -> dict[str, float]:
        """The size of the chart and the edges of its plot, in px."""
        return {
            "wide": WIDE,
            "high": self.high,
            "left": LEFT,
            "right": WIDE - RIGHT,
            "top": TOP,
            "bottom": self.high - BOTTOM,
        }


def chart(
    series: Sequence[Series],
    roles: Mapping[str, str],
    x_range: tuple[float, float],
    x_ticks: Mapping[float, str],
    high: float,
) -> Chart:
    """A chart `high` px high over `x_range` and the shares 0 to 1; `roles` maps models to roles.

    A model without a role is one of OTHER.
    """
    first, last = x_range

    def across(value: float) -> float:
        return round(LEFT + (value - first) / ((last - first) or 1.0) * (WIDE - LEFT - RIGHT), 1)

    def up(value: float) -> float:
        return round(high - BOTTOM - value * (high - TOP - BOTTOM), 1)

    lines = []
    for curve in sorted(
        series, key=lambda curve: (OTHER, NEXT, BEST).index(roles.get(curve.model, OTHER))
    ):
        drawn_points = [
            i
            for i, pair in enumerate(zip(curve.x, curve.y, strict=True))
            if np.isfinite(pair).all()
        ]
        if not drawn_points:
            continue
        points = [(across(curve.x[i]), up(curve.y[i])) for i in drawn_points]
        edges = [
            (across(curve.x[i]), *map(up, curve.bounds[i]))
            for i in drawn_points
            if curve.bounds and np.isfinite(curve.bounds[i]).all()
        ]
        band = [
            *((x, top) for x, _, top in edges),
            *((x, bottom) for x, bottom, _ in reversed(edges)),
        ]
        opened_days = curve.opens or [""] * len(curve.dots)
        dots = [
            (across(x), up(y), text, day)
            for (x, y, text), day in zip(curve.dots, opened_days, strict=True)
            if np.isfinite([x, y]).all()
        ]
        lines.append(
            Line(
                curve.model,
                roles.get(curve.model, OTHER),
                _points(points),
                _points(band),
                dots,
                points[-1],
            )
        )
    heights = _moved_apart([line.end[1] for line in lines], high - BOTTOM)
    named_lines = [
        Line(**{**vars(line), "name_y": y}) for line, y in zip(lines, heights, strict=True)
    ]
    shares = [(up(share), f"{100 * share:.0f} %") for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return Chart(named_lines, [(across(x), text) for x, text in x_ticks.items()], shares, high)


def _points(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:g},{y:g}" for x, y in points)


def _moved_apart(heights: Sequence[float], lowest: float) -> list[float]:
    """Move heights to be at least APART from each other, none below `lowest`.

    One pass goes downwards and one upwards.
    """
    order = np.argsort(heights, kind="stable")
    sorted_heights = np.asarray(heights, float)[order]
    for previous, current in pairwise(range(len(sorted_heights))):
        sorted_heights[current] = max(sorted_heights[current], sorted_heights[previous] + APART)
    if len(sorted_heights):
        sorted_heights[-1] = min(sorted_heights[-1], lowest)
    for current, previous in pairwise(reversed(range(len(sorted_heights)))):
        sorted_heights[previous] = min(sorted_heights[previous], sorted_heights[current] - APART)
    spaced = np.empty(len(sorted_heights))
    spaced[order] = sorted_heights
    return [round(float(y), 1) for y in spaced]
