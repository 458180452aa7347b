"""Fig. 7 of the SCI paper: queries beside the training images that they were matched with, right and wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from pipeline.reports.examples import Example, degrees
from pipeline.reports.result import some
from pipeline.reports.style import STYLE, TEXT_WIDTH_IN, figure
from pipeline.views.scan_context import colorize

WRONG = "#B2182B"


@dataclass(frozen=True)
class Training:
    """What the answers are drawn from."""

    images: Any
    """(submap, ring, sector) heights in metres; slicing reads."""
    places: NDArray[np.int64]
    """(submap,)."""
    xy_m: NDArray[np.float64]
    """(submap, 2)."""

    def answered(self, place: int, xy_m: NDArray[np.float64]) -> int:
        """The submap of a place that lies nearest to where the answer does (2,): at the matched one, or at the place's mean."""
        rows = np.flatnonzero(self.places == place)
        return int(rows[np.linalg.norm(self.xy_m[rows] - xy_m, axis=1).argmin()])

    def nearest(self, xy_m: NDArray[np.float64]) -> int:
        """The submap nearest to a point (2,)."""
        return int(np.linalg.norm(self.xy_m - xy_m, axis=1).argmin())


@matplotlib.rc_context(STYLE)
def matches(
    examples: Sequence[Example], training: Training, images: Callable[[str], Any], simulated: bool, own: bool = True
) -> Figure:
    """A row an example: the query's image, the answered place's, and for a wrong answer the one taken nearest to the query.

    They are the method's `own` views, or stand for what it looks at. `images` gives a test sequence's images (submap, ring,
    sector). Training images are turned to where they look most like the query, as the network's own training copies are turned;
    how far is written in them.
    """
    method = some([example.result for example in examples])[0].method
    heading = f"{method}: queries and the training images they were matched with" + ("" if own else ", as Scan Contexts")
    fig = figure(TEXT_WIDTH_IN, 0.45 + 0.73 * len(examples), simulated, heading)
    axes = fig.subplots(len(examples), 4, squeeze=False, width_ratios=(0.85, 1.0, 1.0, 1.0))
    for row, example in zip(axes, examples, strict=True):
        evaluation, i = example.result.evaluation, example.query
        query = np.asarray(images(example.result.sequence)[i])
        row[0].set_axis_off()
        tint = WRONG if example.wrong else "0.1"
        row[0].text(0.0, 0.5, example.caption(), transform=row[0].transAxes, va="center", size=7, color=tint, linespacing=1.3)
        _show(row[1], query)
        answered = training.answered(int(evaluation.answer[i]), evaluation.answer_xy_m[i])
        _show_turned(row[2], query, np.asarray(training.images[answered]))
        if example.wrong:
            _show_turned(row[3], query, np.asarray(training.images[training.nearest(example.xy_m)]))
            _note(row[3], 0.99, f"{evaluation.nearest_m[i]:.0f} m away")
        else:
            row[3].set_axis_off()
    for axis, title in zip(axes[0, 1:], ("query", "matched with", "nearest in training"), strict=True):
        axis.set_title(title, pad=4)
    low = axes[-1, 1]
    low.set_xticks(np.linspace(-0.5, low.get_xlim()[1], 5)[:4], ("0°", "90°", "180°", "270°"))
    low.set_xlabel("azimuth", labelpad=1, size=7)
    low.set_ylabel("range", labelpad=2, size=7)
    low.tick_params(labelsize=6.5, length=2)
    return fig


def _show(axis: Axes, image: NDArray[np.float32]) -> None:
    """Heights (ring, sector) in the project's jet, the nearest ring at the bottom."""
    axis.imshow(colorize(image), origin="lower", aspect="auto", interpolation="nearest")
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_visible(False)


def _show_turned(axis: Axes, query: NDArray[np.float32], image: NDArray[np.float32]) -> None:
    shift = likest_shift(query, image)
    _show(axis, np.roll(image, shift, axis=1))
    if shift:
        turn_deg = 180 - (180 - shift * 360 / image.shape[1]) % 360
        _note(axis, 0.01, f"rolled {degrees(turn_deg)}")


def _note(axis: Axes, x: float, words: str) -> None:
    """In the lower left or right corner of an image."""
    axis.text(x, 0.06, words, transform=axis.transAxes, color="white", size=6.5, ha="right" if x > 0.5 else "left")


def likest_shift(query: NDArray[np.float32], image: NDArray[np.float32]) -> int:
    """By how many columns to roll an image (ring, sector) so that it correlates best with the query, both a little blurred."""
    spectra = []
    for heights in (query, image):
        blurred = uniform_filter(np.clip(heights, 0.0, 15.0).astype(np.float64), 3, mode=("nearest", "wrap"))
        spectra.append(np.fft.rfft(blurred - blurred.mean(), axis=1))
    likeness = np.fft.irfft((spectra[0] * spectra[1].conj()).sum(axis=0), image.shape[1])
    return int(likeness.round(6).argmax())
