"""What the figures of robustness share: a colour and a dash for each model, and scales that cut nothing."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from numpy.typing import NDArray

from pipeline.reports.style import colour

DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (2, 2)), (0, (8, 2)))
LINE_IN = 0.125
"""Height of a line of text."""


def family(model: str) -> str:
    """The method that a model is a variant of: `sci` of `sci-4way`."""
    return model.partition("-")[0]


def look(models: Sequence[str]) -> dict[str, tuple[str, Any]]:
    """A colour and a dash for each model: its family's colour, darker from variant to variant."""
    kin: dict[str, list[str]] = {}
    for model in sorted(models, key=lambda name: (name != family(name), len(name), name)):
        kin.setdefault(family(model), []).append(model)
    found = {}
    for name, variants in kin.items():
        for i, model in enumerate(variants):
            shade = 1.0 - 0.6 * i / max(len(variants) - 1, 1)
            found[model] = to_hex(_shaded(colour(name), shade)), DASHES[i % len(DASHES)]
    return found


def extent(intervals: Sequence[NDArray[Any]]) -> tuple[float, float]:
    """From the tenth below all that is drawn, but no share below 0, to 1 or what is drawn beyond."""
    shown = np.array([0.9, 1.0, *np.ravel(intervals)])
    shown = shown[np.isfinite(shown)]
    return max(0.0, float(np.floor(shown.min() * 10) / 10)), float(shown.max())


def _shaded(tint: str, shade: float) -> tuple[float, float, float]:
    red, green, blue = to_rgb(tint)
    return shade * red, shade * green, shade * blue
