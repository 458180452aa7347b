"""The artifact of the stage `evaluate`: how well a model answered the queries of a test sequence.

- `Evaluations` holds one `Evaluation` for each case of the queries: unperturbed, or with a
  perturbation such as new walls.
- An `Evaluation` says for each query what was answered and how far off that is. It holds a
  `Judgement` for each protocol: by grid cells and by distance.
- A `Judgement` has the outcome of each query, and numbers with their intervals.

`judge` computes them; the table of results and the report read them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError
from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.core.precisions import JUDGED_PRECISION
from pipeline.core.schemas import Cases
from pipeline.core.store import Array, Artifact, Stack
from pipeline.evaluation.bootstrap import Estimate, blocks
from pipeline.evaluation.caveats import CAVEATS, DEGENERATE, caveats
from pipeline.evaluation.counts import ExactCounts
from pipeline.evaluation.numbers import MEASURES, NUMBERS, average, curve, within
from pipeline.evaluation.protocols import PROTOCOLS, GroundTruth
from pipeline.posing.covariances import largest_squares

TRUE_POSITIVE, FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_NEGATIVE, NOT_JUDGED = range(5)
"""Outcomes of a query."""
VERDICTS = ("accepted", "near", "ambiguous", "rejected", "no_pose")
"""The answers to a query of a method with poses, as a site gives them (METHODS 9.5)."""
ELLIPSOIDS = (0.5, 0.9, 0.95)
"""The ellipsoids of a pose's covariance that should hold these shares of the true poses."""
WEAKER_VERDICTS = {"place": "near", "several": "ambiguous"}
"""Kind of novelty to the verdict if that novelty is accepted though the pose is not.

Each kind is a weaker claim than the pose, the stronger first: the query is near the pose (`place`),
or one of several poses is right (`several`). They are two of posing.verdict.CLAIMS. The first
accepted one wins.
"""


@dataclass(frozen=True, eq=False)
class Judgement:
    """How q queries were answered, judged by one protocol and by the first n answers.

    An axis whose name ends in a number, such as `bound3`, has that length.
    """

    recall_at: Annotated[
        NDArray[np.float64],
        Array(
            ("top_n",),
            "share of the seen queries with a true place among the first n; NaN if none is seen",
        ),
    ]
    true_rank: Annotated[
        NDArray[np.int64],
        Array(("query",), "0-based rank of the first true place; −1 if unseen or not ranked"),
    ]
    seen: Annotated[NDArray[np.bool_], Array(("query",), "training went there")]
    unseen: Annotated[
        NDArray[np.bool_],
        Array(("query",), "training never went there; a query that is neither is not judged"),
    ]
    outcome: Annotated[
        NDArray[np.int8],
        Array(
            ("query",),
            "0 true positive, 1 false negative, 2 false positive, 3 true negative (the SCI "
            "paper's hit, miss, false alarm and correct rejection), 4 not judged",
        ),
    ]
    oracle_right: Annotated[
        NDArray[np.bool_], Array(("query",), "answering the nearest training anchor would be right")
    ]
    numbers: Annotated[
        NDArray[np.float64],
        Array(
            ("number", "bound3"),
            "the three bounds are the value, and the lowest and highest of its 95 % interval; NaN "
            "if there is none",
        ),
    ]
    rejection: Annotated[
        NDArray[np.float64],
        Array(
            ("kind", "measure", "bound3"),
            "how well each novelty rejects; the three bounds are those of `numbers`",
        ),
    ]

    @property
    def answered(self) -> float:
        """The share of the judged queries that are accepted; 0 if none is judged."""
        answered_count = np.isin(self.outcome, (TRUE_POSITIVE, FALSE_POSITIVE)).sum()
        judged_count = (self.outcome != NOT_JUDGED).sum()
        return float(answered_count / max(judged_count, 1))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One model's answers to the queries of one case in one test sequence, and how they are judged.

    What a model answers is a place; with poses, it is a pose too (`has_poses`). A number that the
    descriptions call null is null in the artifact's file, and NaN here. An axis whose name ends in
    a number, such as `confidence2`, has that length.
    """

    judgements: Annotated[Sequence[Judgement], Stack("protocol")]
    """One for each of PROTOCOLS."""
    thresholds: Annotated[
        NDArray[np.float64], Array(("threshold",), "novelties from which a query is rejected")
    ]
    calibration: Annotated[
        NDArray[np.float64],
        Array(
            ("confidence2",),
            "expected calibration errors of the two confidences: 1 − cost, and the method's own",
        ),
    ]
    novelty: Annotated[
        NDArray[np.float32], Array(("query", "kind"), "as ranked; the first kind is the one in use")
    ]
    confidence: Annotated[NDArray[np.float32], Array(("query",), "as ranked")]
    answer: Annotated[NDArray[np.int64], Array(("query",), "the place ranked first")]
    cost: Annotated[NDArray[np.float32], Array(("query",), "cost of that place")]
    xy_m: Annotated[
        NDArray[np.float64], Array(("query", "xy"), "where the query was taken", unit="m")
    ]
    answer_xy_m: Annotated[
        NDArray[np.float64], Array(("query", "xy"), "where the first answer lies", unit="m")
    ]
    error_m: Annotated[
        NDArray[np.float64],
        Array(("query",), "distance from the query to the first answer", unit="m"),
    ]
    heading_error_deg: Annotated[
        NDArray[np.float64],
        Array(
            ("query",),
            "heading of the answer against the true one, 0 to 180; NaN if there is none",
            unit="degree",
        ),
    ]
    nearest_m: Annotated[
        NDArray[np.float64], Array(("query",), "distance to the nearest training anchor", unit="m")
    ]
    turn_deg: Annotated[
        NDArray[np.float64],
        Array(("query",), "heading against the nearest training anchor's", unit="degree"),
    ]
    pose_error_m: Annotated[
        NDArray[np.float64],
        Array(("query",), "distance of the pose from the true one; NaN if there is none", unit="m"),
    ]
    pose_error_deg: Annotated[
        NDArray[np.float64],
        Array(
            ("query",), "turn of the pose against the true one; NaN if there is none", unit="degree"
        ),
    ]
    pose_square: Annotated[
        NDArray[np.float64],
        Array(
            ("query",),
            "squared error of the pose, normalised by its covariance, in six dimensions, of level "
            "sweeps in x, y and heading; NaN if there is none",
        ),
    ]
    kinds: Annotated[tuple[str, ...], "name of each kind of novelty"]
    reject_from: Annotated[tuple[float, ...], "novelty from which the model rejects, for each kind"]
    reject_pose_from: Annotated[
        float,
        "novelty from which a pose is rejected: the threshold for kept_precision; null for a "
        "method that gives no poses",
    ]
    kept_precision: Annotated[
        float,
        f"the precision that accepted poses keep: {JUDGED_PRECISION:g}, or the largest target "
        "precision below it that has a threshold; null if there is none, or no poses",
    ]
    right_within: Annotated[tuple[float, float], "metres and degrees within which a pose is right"]
    target_precision: Annotated[
        float, "the precision that reject_from was chosen for; null if it is not known"
    ]
    validation_precision: Annotated[
        tuple[float, ...],
        "the precision that reject_from reaches on validation blocks of training, for each kind; "
        "null if it is not known, or nothing is accepted",
    ]
    days: Annotated[int, "whole days since the training sequence"]
    claims: Annotated[
        Mapping[str, float],
        "for each kind of WEAKER_VERDICTS, the novelty from which that weaker claim is rejected: "
        "the threshold for kept_precision; empty for a method that gives no poses",
    ]
    blind: Annotated[
        Mapping[str, float],
        "by protocol, recall@1 of a single answer to every query; null if none is seen",
    ]
    block_m: Annotated[float, "length along the path of the blocks that the bootstrap draws"]
    unsuited: Annotated[
        Mapping[str, float],
        "reasons why the submaps do not suit the views, each with the value that says so",
    ]

    @property
    def cells(self) -> Judgement:
        """The judgement by grid cells: an answer is right if it is the query's cell."""
        return self.protocol("cells")

    @property
    def distance(self) -> Judgement:
        """The judgement by distance: an answer is right if it is near enough to the query."""
        return self.protocol("distance")

    @property
    def has_poses(self) -> bool:
        """Whether the method estimates poses; if so, poses are accepted or rejected, not places."""
        return not np.isnan(self.reject_pose_from)

    @property
    def is_level(self) -> bool:
        """Whether the poses are of level sweeps."""
        return self.right_within == LEVEL_RIGHT_WITHIN

    @property
    def pose_accepted(self) -> NDArray[np.bool_]:
        """Which poses (q,) are accepted, at `kept_precision`.

        A missing pose has a novelty of 1, so it is never accepted.
        """
        return self.novelty[:, 0].astype(np.float64) < self.reject_pose_from

    @property
    def pose_right(self) -> NDArray[np.bool_]:
        """Which poses (q,) are near enough to the true pose; a missing pose is not."""
        return within(self.right_within, self.pose_error_m, self.pose_error_deg)

    @property
    def acceptance(self) -> dict[str, NDArray[np.bool_]]:
        """Which answers (q,) are accepted, and refused, and which of either are wrong.

        Answers are poses if the method estimates poses, else places. The poses of all queries
        count, seen or not. A pose is wrong if it is farther off than `right_within`; a missing pose
        is not wrong. Places are judged by distance: a place is wrong if it is farther off than
        `correct_m` of that protocol, or if the query is unseen.
        """
        if self.has_poses:
            judged = np.ones(len(self.answer), bool)
            accepted = self.pose_accepted
            wrong = ~self.pose_right & ~np.isnan(self.pose_error_m)
        else:
            judged = self.distance.outcome != NOT_JUDGED
            accepted = np.isin(self.distance.outcome, (TRUE_POSITIVE, FALSE_POSITIVE))
            wrong = judged & ~(self.distance.seen & (self.distance.true_rank == 0))
        refused = judged & ~accepted
        return {
            "accepted": accepted,
            "accepted_wrong": accepted & wrong,
            "refused": refused,
            "refused_wrong": refused & wrong,
        }

    @property
    def verdicts(self) -> dict[str, int]:
        """How many queries, seen or not, get each of VERDICTS.

        Poses are accepted at `kept_precision`. Empty for a method without poses.
        """
        if not self.has_poses:
            return {}
        codes = np.full(len(self.novelty), VERDICTS.index("rejected"))
        # From the weakest claim to the strongest, each of which overrules those before it.
        for kind, verdict in reversed(WEAKER_VERDICTS.items()):
            if kind in self.kinds:
                error_probability = self.novelty[:, self.kinds.index(kind)].astype(np.float64)
                codes[error_probability < self.claims[kind]] = VERDICTS.index(verdict)
        codes[self.pose_accepted] = VERDICTS.index("accepted")
        codes[np.isnan(self.pose_error_m)] = VERDICTS.index("no_pose")
        return {verdict: int((codes == code).sum()) for code, verdict in enumerate(VERDICTS)}

    @property
    def pose_probabilities(self) -> NDArray[np.float64]:
        """The probability (q,) that the pose is right, as the method estimates it."""
        return 1 - self.novelty[:, 0].astype(np.float64)

    @property
    def in_ellipsoids(self) -> dict[str, float]:
        """The share of the accepted poses whose ellipsoid of a share of ELLIPSOIDS has the truth.

        NaN without an accepted pose that has a covariance.
        """
        squares = self.pose_square[self.pose_accepted & np.isfinite(self.pose_square)]
        largest_of_each = largest_squares(ELLIPSOIDS, 3 if self.is_level else 6)
        return {
            f"in_ellipsoid_{100 * share:.0f}": average(squares < largest)
            for share, largest in zip(ELLIPSOIDS, largest_of_each, strict=True)
        }

    def protocol(self, name: str) -> Judgement:
        """The judgement by one of PROTOCOLS."""
        return self.judgements[PROTOCOLS.index(name)]

    def caveats(self, name: str) -> dict[str, float]:
        """The caveats about the numbers by that protocol, name to value (evaluation.caveats)."""
        seen = self.protocol(name).seen
        seen_blocks = np.unique(blocks(self.xy_m, self.block_m)[seen])
        caveats_of_answers = caveats(
            blind_recall=self.blind[name],
            answers=self.answer,
            novelty=self.novelty[:, 0],
            reject_from=self.reject_from[0],
            validation_precision=self.validation_precision[0],
            target_precision=self.target_precision,
            seen_count=int(seen.sum()),
            block_count=len(seen_blocks),
        )
        return caveats_of_answers | dict(self.unsuited)

    def ground_truth(self, name: str) -> GroundTruth:
        """Which queries are seen and answered right by that protocol."""
        judgement = self.protocol(name)
        return GroundTruth(
            judgement.seen,
            judgement.unseen,
            judgement.true_rank,
            judgement.oracle_right,
            recall_of_all_seen=name == "distance",
        )

    def number(self, protocol: str, name: str) -> Estimate:
        """One of NUMBERS with its 95 % interval; NaN if undefined."""
        return Estimate(*self.protocol(protocol).numbers[NUMBERS.index(name)].tolist())

    def curve(
        self, protocol: str, thresholds: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Precision and recall (t,) of the first answers at these thresholds, by one protocol.

        Without any, every novelty in use is a threshold: the first accepts no query, the last all.
        By cells an answer outside all places is always rejected: it says that the query is unseen.
        """
        ground_truth = self.ground_truth(protocol)
        is_outside = (self.answer < 0) & (protocol == "cells")
        novelty = np.where(is_outside, np.inf, self.novelty[:, 0])
        once = np.ones((1, len(self.answer)))
        exact = ExactCounts(ground_truth, novelty, once)
        columns = slice(None) if thresholds is None else exact.columns(thresholds)
        precision, recall = curve(ground_truth, exact.count(1, columns), once @ ground_truth.seen)
        return precision[0], recall[0]


@dataclass(frozen=True, eq=False)
class Evaluations(Artifact, kind="evaluations", version=16):
    """The evaluations of a model on one test sequence, one for each case of its queries."""

    evaluations: Annotated[Sequence[Evaluation], Stack("case")]
    """One for each of `cases`; the first case is unperturbed."""
    cases: Cases
    sequence: Annotated[str, "the test sequence"]
    train: Annotated[str, "the training sequence"]
    distance: Annotated[Mapping[str, Any], "the distances of the protocol by distance, in metres"]
    bootstrap: Annotated[Mapping[str, Any], "how the intervals were computed"]
    protocols: Annotated[tuple[str, ...], "name of each protocol"] = field(
        default_factory=lambda: PROTOCOLS
    )
    numbers: Annotated[tuple[str, ...], "name of each number"] = field(
        default_factory=lambda: NUMBERS
    )
    measures: Annotated[tuple[str, ...], "name of each measure of rejection"] = field(
        default_factory=lambda: MEASURES
    )

    def case(self, i: int = 0) -> Evaluation:
        """The evaluation of one case; the first is unperturbed.

        Raises ArtifactError if other protocols, numbers or measures were evaluated.
        """
        axes = {"protocols": PROTOCOLS, "numbers": NUMBERS, "measures": MEASURES}
        for name, expected in axes.items():
            if getattr(self, name) != expected:
                raise ArtifactError(
                    f"{self.path}: its {name} are not this version's; `dvc repro` it"
                )
        return self.evaluations[i]


def metrics(evaluation: Evaluation) -> dict[str, float]:
    """The few numbers that `dvc metrics show` prints for a model and sequence.

    auc_top1 is that of the SCI paper (Kim, Park and Kim, RA-L 2019), by cells; the others are by
    distance. Undefined numbers are left out.
    """
    shown = {
        "auc_top1": evaluation.number("cells", "auc_top1").value,
        "recall_at_1": evaluation.number("distance", "recall_at_1").value,
        "answered": evaluation.distance.answered,
        "right_of_answered": evaluation.number("distance", "precision_at_threshold").value,
        "validation_precision": evaluation.validation_precision[0],
        "within_2m_5deg": evaluation.number("distance", "within_2m_5deg").value,
    }
    return {name: value for name, value in shown.items() if np.isfinite(value)}


def line(evaluation: Evaluation, protocol: str) -> str:
    """The main numbers of an evaluation on one line, with its caveats (`caveats`) in brackets."""
    texts = []
    for name in ("auc_top1", "recall_at_1", "auroc"):
        value = evaluation.number(protocol, name).value
        texts.append(f"{name} {value:.3f}" if np.isfinite(value) else f"{name} none")
    listed = evaluation.caveats(protocol)
    if present := [name for name in (DEGENERATE, *CAVEATS) if name in listed]:
        words = [name.removeprefix("caveat_").replace("_", " ") for name in present]
        texts.append(f"({', '.join(words)})")
    return " ".join(texts)
