"""Fig. 7 of the SCI paper: queries beside the training images that they were matched with, right and wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from pipeline.report.figures.examples import Example, degrees
from pipeline.report.figures.style import WIDTH_IN, figure, styled
from pipeline.report.study import some
from pipeline.views.scan_context import colorize

WRONG = "#B2182B"


@dataclass(frozen=True)
class Training:
    """The training sequence, of which the answers are shown."""

    images: Any  # (submap, ring, sector) heights in metres; slicing reads
    places: NDArray[np.int64]  # (submap,)
    xy_m: NDArray[np.float64]  # (submap, 2)

    def answered(self, place: int, xy_m: NDArray[np.float64]) -> int:
        """The submap of a place that lies nearest to the answer's position (2,)."""
        rows = np.flatnonzero(self.places == place)
        return int(rows[np.linalg.norm(self.xy_m[rows] - xy_m, axis=1).argmin()])

    def nearest(self, xy_m: NDArray[np.float64]) -> int:
        """The submap nearest to a position (2,)."""
        return int(np.linalg.norm(self.xy_m - xy_m, axis=1).argmin())


@styled
def matches(
    examples: Sequence[Example], training: Training, images: Callable[[str], Any], simulated: bool, own: bool = True
) -> Figure:
    """A row an example: the query's image, the answered place's, and for a wrong answer the training image nearest to the query.

    `images` gives a test sequence's images (submap, ring, sector), `own` says that they are the model's own views. Training
    images are rolled to the heading at which they look most like the query, as the network's own training copies are.
    """
    model = some([example.result for example in examples])[0].model
    heading = f"{model}: queries and the training images they were matched with" + ("" if own else ", as Scan Contexts")
    fig = figure(WIDTH_IN, 0.45 + 0.73 * len(examples), simulated, heading)
    axes = fig.subplots(len(examples), 4, squeeze=False, width_ratios=(0.85, 1.0, 1.0, 1.0))
    for (text, left, middle, right), example in zip(axes, examples, strict=True):
        evaluation, i, wrong = example.result.evaluation, example.query, example.verdict != "right"
        query, tint = np.asarray(images(example.result.sequence)[i]), WRONG if wrong else "0.1"
        text.set_axis_off()
        text.text(0.0, 0.5, example.caption(), transform=text.transAxes, va="center", size=7, color=tint, linespacing=1.3)
        _show(left, query)
        answered = training.answered(int(evaluation.answer[i]), evaluation.answer_xy_m[i])
        _show(middle, query, np.asarray(training.images[answered]))
        if wrong:
            _show(right, query, np.asarray(training.images[training.nearest(example.xy_m)]))
            _note(right, 0.99, f"{evaluation.nearest_m[i]:.0f} m away")
        else:
            right.set_axis_off()
    for axis, title in zip(axes[0, 1:], ("query", "matched with", "nearest in training"), strict=True):
        axis.set_title(title, pad=4)
    low = axes[-1, 1]
    low.set_xticks(np.linspace(-0.5, low.get_xlim()[1], 5)[:4], ("0°", "90°", "180°", "270°"))
    low.set_xlabel("azimuth", labelpad=1, size=7)
    low.set_ylabel("range", labelpad=2, size=7)
    low.tick_params(labelsize=6.5, length=2)
    return fig


def _show(axis: Axes, query: NDArray[np.float32], image: NDArray[np.float32] | None = None) -> None:
    """A query, or an image rolled towards it: heights (ring, sector) in the project's jet, the nearest ring at the bottom."""
    image = query if image is None else image
    shift = 0 if image is query else best_shift(query, image)
    axis.imshow(colorize(np.roll(image, shift, axis=1)), origin="lower", aspect="auto", interpolation="nearest")
    axis.set(xticks=[], yticks=[])
    axis.spines[:].set_visible(False)
    if shift:
        _note(axis, 0.01, f"rolled {degrees(180 - (180 - shift * 360 / image.shape[1]) % 360)}")


def _note(axis: Axes, x: float, text: str) -> None:
    """In the lower left or right corner of an image."""
    axis.text(x, 0.06, text, transform=axis.transAxes, color="white", size=6.5, ha="right" if x > 0.5 else "left")


def best_shift(query: NDArray[np.float32], image: NDArray[np.float32]) -> int:
    """By how many columns to roll an image (ring, sector) so that it correlates best with the query, both slightly blurred."""
    spectra = []
    for heights in (query, image):
        blurred = uniform_filter(np.clip(heights, 0.0, 15.0).astype(np.float64), 3, mode=("nearest", "wrap"))
        spectra.append(np.fft.rfft(blurred - blurred.mean(), axis=1))
    correlation = np.fft.irfft((spectra[0] * spectra[1].conj()).sum(axis=0), image.shape[1])
    return int(correlation.round(6).argmax())
