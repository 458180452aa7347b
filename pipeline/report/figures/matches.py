"""Fig. 7 of the SCI paper (Kim, Park and Kim, RA-L 2019): queries beside their matched images.

`choose` picks a model's examples: right answers over the year, and of each kind of wrong answers
those of least novelty, of which the model was surest. `matches` draws them, a row each.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.core.frames import wrapped_deg
from pipeline.evaluation.evaluations import FALSE_POSITIVE, TRUE_POSITIVE, Evaluation
from pipeline.report.alignment import best_shift
from pipeline.report.figures.style import WIDTH_IN, figure, styled
from pipeline.report.result import Result
from pipeline.views.scan_context import colorize

RIGHT_SEQUENCES = 3  # the number of sequences that have a right example
# Kinds of wrong answers, and how many examples to show of each; see `_is_kind`.
NEXT_CELL = "next cell"
MISPLACED = "misplaced"
UNSEEN = "unseen"
WRONG = {NEXT_CELL: 1, MISPLACED: 4, UNSEEN: 2}
APART_M = 40.0  # least distance between examples of one kind, so that they are no neighbours
TURNED_DEG = 90.0  # a query that heads farther off training's heading is turned
RED = "#B2182B"


@dataclass(frozen=True, eq=False)
class Example:
    """A query shown in the figure."""

    result: Result
    query: int
    verdict: str  # "right" or a kind of wrong answer

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """Position of the query (2,) in the world."""
        return np.asarray(self.result.evaluation.xy_m[self.query])

    @property
    def novelty(self) -> float:
        """The query's novelty of the kind in use."""
        return float(self.result.evaluation.novelty[self.query, 0])

    def caption(self) -> str:
        """Verdict, sequence, novelty, error and heading, in four lines."""
        evaluation = self.result.evaluation
        error_m = evaluation.error_m[self.query]
        accepted = "accepted" if self.novelty < evaluation.reject_from[0] else "rejected"
        return (
            f"{self.verdict}, {accepted}\n{self.result.label}\n"
            f"novelty {self.novelty:.3f}, {error_m:.{int(error_m < 9.95)}f} m off\n"
            f"heading {degrees(evaluation.turn_deg[self.query])} to training"
        )

    def is_far_from(self, examples: Sequence["Example"]) -> bool:
        """Whether the query is at least APART_M from the queries of all other examples."""
        return all(np.linalg.norm(self.xy_m - example.xy_m) >= APART_M for example in examples)


def choose(group: Sequence[Result]) -> list[Example]:
    """Examples of one model: right ones over the year, one of them turned; wrong ones of each kind.

    Wrong ones are those of least novelty that lie apart.
    """
    chosen = _right(group)
    for kind, most in WRONG.items():
        examples: list[Example] = []
        for example in _surest(group, kind):
            if len(examples) < most and example.is_far_from(examples):
                examples.append(example)
        chosen += examples
    return chosen


def _right(group: Sequence[Result]) -> list[Example]:
    """Right answers in RIGHT_SEQUENCES sequences, then the surest one that is turned."""
    right_by_day = [
        right_answers for result in group if (right_answers := _surest([result], "right"))
    ]
    chosen: list[Example] = []
    spread = np.linspace(0, len(right_by_day) - 1, RIGHT_SEQUENCES if right_by_day else 0)
    for day in np.unique(spread.round().astype(int)):
        right_answers = right_by_day[day]
        middle = len(right_answers) // 2
        outwards = sorted(range(len(right_answers)), key=lambda i: abs(i - middle))
        far = (right_answers[i] for i in outwards if right_answers[i].is_far_from(chosen))
        chosen.append(next(far, right_answers[middle]))
    for right in _surest(group, "right"):
        is_turned = abs(right.result.evaluation.turn_deg[right.query]) > TURNED_DEG
        is_new = all(right.result is not e.result or right.query != e.query for e in chosen)
        if is_turned and is_new:
            return [*chosen, right]
    return chosen


def _surest(group: Sequence[Result], verdict: str) -> list[Example]:
    """The answers of a verdict in all sequences, least novel first."""
    examples = [
        Example(result, int(i), verdict)
        for result in group
        for i in np.flatnonzero(_is_kind(result.evaluation, verdict))
    ]
    return sorted(examples, key=lambda example: example.novelty)


def _is_kind(evaluation: Evaluation, verdict: str) -> NDArray[np.bool_]:
    """Which answers (q,) are of a verdict: "right", or one of the kinds of WRONG."""
    cells = evaluation.cells
    distance = evaluation.distance
    placed_wrong = (distance.true_rank != 0) & (cells.true_rank != 0)
    answers = {
        "right": cells.outcome == TRUE_POSITIVE,
        # near enough, but over the edge of the query's cell
        NEXT_CELL: (cells.outcome == FALSE_POSITIVE)
        & cells.seen
        & (distance.outcome == TRUE_POSITIVE),
        MISPLACED: distance.seen & placed_wrong,
        # accepted where training never was
        UNSEEN: (distance.outcome == FALSE_POSITIVE) & distance.unseen,
    }
    return np.asarray(answers[verdict])


def degrees(angle_deg: float) -> str:
    """An angle with its sign: `+4°`, `−177°`."""
    return f"{round(angle_deg):+d}°".replace("-", "−")


@dataclass(frozen=True)
class TrainingViews:
    """The training sequence: views, places and positions of the answers."""

    images: Any  # (submap, ring, sector) heights in metres; slicing reads
    places: NDArray[np.int64]  # (submap,)
    xy_m: NDArray[np.float64]  # (submap, 2)

    def answered(self, place: int, xy_m: NDArray[np.float64]) -> int:
        """The submap of a place that is nearest to the answer's position (2,).

        For place −1, which is none, the nearest of all submaps.
        """
        rows = np.flatnonzero((self.places == place) | (place < 0))
        return int(rows[np.linalg.norm(self.xy_m[rows] - xy_m, axis=1).argmin()])

    def nearest(self, xy_m: NDArray[np.float64]) -> int:
        """The submap nearest to a position (2,)."""
        return int(np.linalg.norm(self.xy_m - xy_m, axis=1).argmin())


@styled
def matches(
    examples: Sequence[Example],
    training: TrainingViews,
    images: Callable[[str], Any],
    own_views: bool = True,
) -> Figure:
    """A row per example: the query's view, the matched training view, and the nearest one if wrong.

    `images` gives the views (submap, ring, sector) of a test sequence; `own_views` says whether the
    model itself looks at them. Training views are rolled to the heading at which they look most
    like the query, as the network's training copies are.
    """
    heading = f"{examples[0].result.model}: queries and the training images they were matched with"
    if not own_views:
        heading += ", as Scan Contexts"
    fig = figure(WIDTH_IN, 0.45 + 0.73 * len(examples), heading)
    axes = fig.subplots(len(examples), 4, squeeze=False, width_ratios=(0.85, 1.0, 1.0, 1.0))
    for (text, left, middle, right), example in zip(axes, examples, strict=True):
        evaluation = example.result.evaluation
        i = example.query
        is_wrong = example.verdict != "right"
        query = np.asarray(images(example.result.sequence)[i])
        text.set_axis_off()
        caption = text.text(0.0, 0.5, example.caption(), transform=text.transAxes, va="center")
        caption.set(size=7, color=RED if is_wrong else "0.1", linespacing=1.3)
        _show(left, query)
        matched = training.answered(int(evaluation.answer[i]), evaluation.answer_xy_m[i])
        _show(middle, query, np.asarray(training.images[matched]))
        if is_wrong:
            _show(right, query, np.asarray(training.images[training.nearest(example.xy_m)]))
            _note(right, "right", f"{evaluation.nearest_m[i]:.0f} m away")
        else:
            right.set_axis_off()
    for axis, title in zip(
        axes[0], ("", "query", "matched with", "nearest in training"), strict=True
    ):
        axis.set_title(title, pad=4)
    low = axes[-1, 1]
    low.set_xticks(np.linspace(-0.5, low.get_xlim()[1], 5)[:4], ("0°", "90°", "180°", "270°"))
    low.set_xlabel("azimuth", labelpad=1, size=7)
    low.set_ylabel("range", labelpad=2, size=7)
    low.tick_params(labelsize=6.5, length=2)
    return fig


def _show(axis: Axes, query: NDArray[np.float32], image: NDArray[np.float32] | None = None) -> None:
    """Draw a query, or an image rolled towards it if one is given."""
    shift = 0 if image is None else best_shift(query, image)
    image = query if image is None else image
    rolled = colorize(np.roll(image, shift, axis=1))
    axis.imshow(rolled, origin="lower", aspect="auto", interpolation="nearest")
    axis.set(xticks=[], yticks=[])
    axis.spines[:].set_visible(False)
    if shift:
        rolled_deg = float(wrapped_deg(shift * 360 / image.shape[1]))
        _note(axis, "left", f"rolled {degrees(rolled_deg)}")


def _note(axis: Axes, side: str, text: str) -> None:
    """Write in the lower corner of a view on the `left` or `right` side."""
    x = 0.99 if side == "right" else 0.01
    axis.text(x, 0.06, text, transform=axis.transAxes, color="white", size=6.5, ha=side)
