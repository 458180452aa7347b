"""Paper 2's test of viewpoints: a sequence is matched with itself, seen from other headings.

In: a trained method and the bird-views of a sequence at an even number of headings. The reference
are the views at every other heading, the queries those at the headings between. Out: which query
was matched with which row of the sequence, how far off that is, and the metrics of the paper.
Nothing but the heading differs between query and reference (METHODS.md 5.4 and 5.5).

Paper 2 is Yin et al., "Stabilize an Unsupervised Feature Learning for LiDAR-based Place
Recognition" (IROS 2018).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import pose
from pipeline.core.settings import Positive, checked
from pipeline.core.store import Array, Artifact
from pipeline.evaluation.counts import ExactCounts
from pipeline.evaluation.curves import Curve, auc, auroc, precision_recall, recall_at_precision
from pipeline.evaluation.numbers import PRECISE
from pipeline.evaluation.protocols import GroundTruth
from pipeline.matching.ranking import Method, Model, Rows

NUMBERS = ("roc_auc", "pr_auc", "accuracy", "recall")
"""The numbers of the valid queries at one heading. A match is correct if it lies near enough.

- roc_auc, paper 2's "AUC index": the probability that a correct match scores above a wrong one;
  undefined without one of either.
- pr_auc: area under precision over the share of *correct matches* that are accepted, so that a
  method with few correct matches can have a good curve; undefined without any.
- accuracy: share of the queries with a correct match.
- recall: share of the queries whose match is correct and accepted, at a precision of 0.99 or more.
  It is at most the accuracy.
"""
MEAN = "mean"
"""Name of the means over all headings, beside the names of the headings."""
SHOWN = ("roc_auc", "accuracy")
"""The numbers that a line of text shows."""


class BirdViewMethod(Method, Protocol):
    """A method on sequences of bird-views that can take another sequence for its reference."""

    @property
    def length(self) -> int:
        """Number of rows of a sequence that are compared at a time: a window."""

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The model with the same networks, but these views as its database."""

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Reconstruct images (n, side, side) by the network; empty without a network."""


@dataclass(frozen=True, eq=False)
class ViewpointMatches(Artifact, kind="viewpoints", version=2):
    """One method's matches in one sequence: each query from each heading."""

    headings_deg: Annotated[
        NDArray[np.float64],
        Array(
            ("heading",),
            "how far the queries are turned against the sequence's own heading",
            unit="degree",
            chunk=8,
            shard=8,
        ),
    ]
    values: Annotated[
        NDArray[np.float64],
        Array(
            ("heading", "number"),
            "each number at each heading; NaN if it is undefined",
            chunk=8,
            shard=8,
        ),
    ] = field(init=False)
    row: Annotated[
        NDArray[np.int64],
        Array(
            ("heading", "query"),
            "row of the sequence itself that the query was matched with",
            chunk=8,
            shard=8,
        ),
    ]
    answer_xy_m: Annotated[
        NDArray[np.float64],
        Array(
            ("heading", "query", "xy"),
            "where the match lies; NaN if there is none",
            unit="m",
            chunk=8,
            shard=8,
        ),
    ]
    error_m: Annotated[
        NDArray[np.float64],
        Array(
            ("heading", "query"),
            "distance from the query to its match; NaN if there is none",
            unit="m",
            chunk=8,
            shard=8,
        ),
    ]
    score: Annotated[
        NDArray[np.float32],
        Array(
            ("heading", "query"),
            "how sure the match is, larger is surer: the novelty in use, negated",
            chunk=8,
            shard=8,
        ),
    ]
    correct: Annotated[
        NDArray[np.bool_],
        Array(("heading", "query"), "the match lies within correct_m", chunk=8, shard=8),
    ]
    valid: Annotated[
        NDArray[np.bool_],
        Array(
            ("query",), "far enough from the sequence's ends for a whole window of rows around it"
        ),
    ]
    xy_m: Annotated[
        NDArray[np.float64], Array(("query", "xy"), "where the query was taken", unit="m")
    ]
    pictures: Annotated[
        NDArray[np.uint8],
        Array(
            ("picture", "row_px", "col_px"),
            "views of the middle place at the reference's headings",
            chunk=8,
            shard=64,
        ),
    ]
    reconstructed: Annotated[
        NDArray[np.uint8],
        Array(
            ("reconstruction", "row_px", "col_px"),
            "the pictures as the method's network reconstructs them; none without a network",
            chunk=8,
            shard=64,
        ),
    ]
    correct_m: Annotated[float, "largest distance of a correct match, in metres"]
    length: Annotated[int, "steps in a window of rows"]
    novelty: Annotated[str, "name of the novelty in use"]
    bytes_per_place: Annotated[float, "by how much the model grows with a reference place"]
    numbers: Annotated[tuple[str, ...], "name of each number"] = field(
        default_factory=lambda: NUMBERS
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", self._values())

    def curve(self, heading: int) -> tuple[Curve, Curve]:
        """Precision, and the share of correct matches accepted (t,), with every score as threshold.

        The surest matches are accepted first.
        """
        precision, recall = precision_recall(self._counts[heading].count(1))
        return precision[0], recall[0]

    def by_heading(self) -> dict[str, dict[str, float | None]]:
        """NUMBERS by heading, such as `22.5_deg`, and MEAN: their means over the headings.

        None for a number that is undefined; the means leave such numbers out.
        """
        numbers = {
            f"{heading_deg:g}_deg": _by_name(values)
            for heading_deg, values in zip(self.headings_deg, self.values, strict=True)
        }
        finite_columns = [column[np.isfinite(column)] for column in self.values.T]
        numbers[MEAN] = _by_name(
            [column.mean() if len(column) else np.nan for column in finite_columns]
        )
        return numbers

    def _values(self) -> NDArray[np.float64]:
        """NUMBERS at each heading (heading, number); NaN for one that is undefined."""
        rows = []
        for heading, correct in enumerate(self.correct[:, self.valid]):
            precision, share_accepted = self.curve(heading)
            accuracy = correct.mean() if len(correct) else np.nan
            numbers = {
                "roc_auc": auroc(self._counts[heading].count(1)).item(),
                "pr_auc": auc(precision, share_accepted) if correct.any() else np.nan,
                "accuracy": accuracy,
                "recall": recall_at_precision(precision, share_accepted, PRECISE) * accuracy,
            }
            rows.append([numbers[name] for name in NUMBERS])
        return np.array(rows, np.float64).reshape(len(rows), len(NUMBERS))

    @cached_property
    def _counts(self) -> list[ExactCounts]:
        """The counts of accepted correct and wrong matches at each heading.

        A correct match is counted as a seen query, a wrong one as unseen.
        """
        counts = []
        for correct, score in zip(
            self.correct[:, self.valid], self.score[:, self.valid], strict=True
        ):
            ground_truth = GroundTruth(
                seen=correct,
                unseen=~correct,
                true_rank=np.where(correct, 0, -1),
                oracle_right=correct,
            )
            counts.append(ExactCounts(ground_truth, -score, np.ones((1, len(score)))))
        return counts


def _by_name(values: Iterable[float]) -> dict[str, float | None]:
    """Values in the order of NUMBERS, by name; None for one that is NaN."""
    return {
        name: float(value) if np.isfinite(value) else None
        for name, value in zip(NUMBERS, values, strict=True)
    }


@dataclass(frozen=True)
@checked("viewpoints")
class Viewpoints:
    """Matches a sequence of bird-views with itself from other headings, and judges the matches."""

    correct_m: Positive = 10.0
    """A match is correct if it lies at most this far from the query."""

    def judge(self, method: BirdViewMethod, model: Model, views: Rows) -> ViewpointMatches:
        """Localize each row of `views`, bird-views (n, headings, side, side), at odd headings.

        The reference are the images at the even headings; each query looks half way between two of
        them. Raises InputError for views of another shape.
        """
        images = np.asarray(views.images[:])
        n = len(views.world_T_anchor)
        if images.ndim != 4 or len(images) != n or images.shape[1] % 2:
            raise InputError(
                f"views of shape {images.shape}: expected bird-views ({n}, an even number of "
                "headings, side, side)"
            )
        views = Rows(images, views.stamps_ns, views.world_T_anchor)
        # The reference: each row is a place of its own. The method takes the even headings of it.
        reference_model = method.moved(model, views, np.arange(n))
        localize = method.localizer(reference_model)
        headings = range(1, images.shape[1], 2)
        rankings = [localize(turned(views, heading), 1) for heading in headings]
        xy_m = views.world_T_anchor[:, :2, 3].astype(np.float64)
        answer_xy_m = np.stack([ranking.xy_m[:, 0] for ranking in rankings]).astype(np.float64)
        error_m = np.linalg.norm(answer_xy_m - xy_m, axis=2)
        # A window of `length` steps around a row must lie within the sequence.
        steps_before = method.length // 2
        steps_behind = method.length - steps_before
        position = np.arange(n)
        return ViewpointMatches(
            headings_deg=np.array(headings) * 360 / images.shape[1],
            row=np.stack([ranking.places[:, 0] for ranking in rankings]),
            answer_xy_m=answer_xy_m,
            error_m=error_m,
            score=-np.stack([ranking.novelty[:, 0] for ranking in rankings]),
            correct=error_m <= self.correct_m,
            valid=(position >= steps_before) & (position < n - steps_behind),
            xy_m=xy_m,
            pictures=images[n // 2, ::2],
            reconstructed=method.reconstructed(model, images[n // 2, ::2]),
            correct_m=float(self.correct_m),
            length=method.length,
            novelty=rankings[0].kinds[0],
            bytes_per_place=_bytes_per_place(method, reference_model, views),
        )


def turned(views: Rows, heading: int) -> Rows:
    """The same places, seen by a robot that is turned counter-clockwise by this many headings.

    Headings are evenly spaced around the circle. Image 0 is the view ahead of the turned robot.
    """
    images = np.roll(views.images[:], -heading, axis=1)
    yaw_rad = 2 * np.pi * heading / images.shape[1]
    vehicle_T_turned = pose(np.zeros((1, 3)), np.array([[0.0, 0.0, yaw_rad]]))[0]
    return Rows(images, views.stamps_ns, views.world_T_anchor @ vehicle_T_turned)


def _bytes_per_place(method: BirdViewMethod, reference_model: Model, views: Rows) -> float:
    """Bytes by which the model grows with each place: its codes or image, and its position."""
    one_place_model = method.moved(reference_model, views.select(slice(1)), np.arange(1))
    all_bytes = sum(array.nbytes for array in reference_model.values())
    one_place_bytes = sum(array.nbytes for array in one_place_model.values())
    return (all_bytes - one_place_bytes) / max(len(views.images) - 1, 1)


def means(numbers: Mapping[str, Mapping[str, float | None]]) -> dict[str, float]:
    """The means of SHOWN over the headings, by name; undefined ones are left out."""
    return {name: mean for name in SHOWN if (mean := numbers[MEAN][name]) is not None}


def line(numbers: Mapping[str, Mapping[str, float | None]]) -> str:
    """The means of SHOWN as one line of text."""
    shown = means(numbers)
    return ", ".join(
        f"{name} {shown[name]:.3f}" if name in shown else f"{name} none" for name in SHOWN
    )
