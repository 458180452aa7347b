"""Judges a model's answers: rankings, labels and true poses in; an `Evaluation` out.

The stage `evaluate` calls `judge_cases`, which judges one test sequence in each of its cases:
unperturbed, and with each perturbation. `judge` judges the queries of one case in three steps:

1. the errors of each first answer and of each estimated pose (`Queries`);
2. what counts as seen and as right, once by cells and once by distance (`GroundTruth`);
3. by each of these two protocols the outcomes, and every number with its interval.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import (
    LEVEL_RIGHT_WITHIN,
    RIGHT_WITHIN,
    Poses,
    distance_and_turn,
    turns,
    wrapped_deg,
    yaw,
)
from pipeline.core.precisions import JUDGED_PRECISION
from pipeline.core.schemas import Fixes, Labels, Rankings, SequenceRanking, Submaps
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.calibration import ece, probabilities
from pipeline.evaluation.caveats import UNCALIBRATED, blind, unsuited
from pipeline.evaluation.counts import TOP_N, even_thresholds, is_right_at
from pipeline.evaluation.evaluations import (
    FALSE_NEGATIVE,
    FALSE_POSITIVE,
    NOT_JUDGED,
    TRUE_NEGATIVE,
    TRUE_POSITIVE,
    WEAKER_VERDICTS,
    Evaluation,
    Judgement,
)
from pipeline.evaluation.numbers import (
    MEASURES,
    NUMBERS,
    Queries,
    Weight,
    measures,
    numbers,
    share,
)
from pipeline.evaluation.protocols import Distance, GroundTruth, by_cells
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.perturbations import Case, read_cases
from pipeline.posing.covariances import normalised_squares, pose_errors

LEVEL_DIMENSIONS = slice(2, 5)
"""The turn about z and the steps along x and y, among the six dimensions of a covariance."""


class PoseEstimates(NamedTuple):
    """The poses that a method estimates of q queries."""

    world_T_query: Poses
    """(q, 4, 4); NaN for a query without a pose."""
    reject_from: float
    """A pose is rejected if its novelty is this or more: the threshold for `kept_precision`."""
    right_within: tuple[float, float] = RIGHT_WITHIN
    """Metres and degrees within which a pose is right."""
    covariance: NDArray[np.float64] | None = None
    """(q, 6, 6) of a small turn in radians, then of a step in metres, in the query's frame; NaN or
    infinite for a query without one."""
    kept_precision: float = JUDGED_PRECISION
    """The precision that accepted poses keep; NaN if none can be kept."""

    def squares(self, world_T_true: Poses) -> NDArray[np.float64]:
        """The squared error (q,) of each pose, normalised by its covariance; NaN without one.

        Of level sweeps it is that of x, y and heading.
        """
        dimensions = LEVEL_DIMENSIONS if self.right_within == LEVEL_RIGHT_WITHIN else slice(None)
        squares = np.full(len(self.world_T_query), np.nan)
        if self.covariance is not None:
            is_known = np.isfinite(self.world_T_query).all(axis=(1, 2))
            is_known &= np.isfinite(self.covariance).all(axis=(1, 2))
            errors = pose_errors(self.world_T_query[is_known], world_T_true[is_known])
            covariance = self.covariance[is_known][:, dimensions][:, :, dimensions]
            squares[is_known] = normalised_squares(errors[:, dimensions], covariance)
        return squares


def judge_cases(
    rankings: SequenceRanking,
    labels: Labels,
    submaps: Submaps,
    distance: Distance,
    bootstrap: Bootstrap,
) -> dict[Case, Evaluation]:
    """Judge the rankings of one test sequence, case by case.

    Labels and submaps are those of the unperturbed sequence: a row a query, the same rows for each
    case. Raises InputError unless the rankings have one row a submap and case.
    """
    cases = read_cases(rankings.cases)
    query_count = len(submaps.world_T_anchor)
    if len(rankings.turned_deg) != query_count * len(cases):
        raise InputError(
            f"{rankings.path}: {len(rankings.turned_deg)} queries in {len(cases)} cases of "
            f"{query_count} submaps"
        )
    claims: dict[str, float] = {}
    caveats = unsuited(submaps)
    validation_precision: tuple[float, ...] = ()
    if isinstance(rankings, Rankings):
        validation_precision = rankings.validation_precision
    elif isinstance(rankings, Fixes):
        claims = {claim: rankings.reject_from(claim=claim) for claim in WEAKER_VERDICTS}
        # The first kind is the error probability of the pose. Its threshold reaches the target
        # precision on validation blocks, or accepts nothing; without blocks nothing is known.
        accepts_poses = rankings.thresholds[0] > ACCEPT_NOTHING and rankings.validation_blocks > 0
        if not rankings.validation_blocks:
            caveats[UNCALIBRATED] = 1.0
        precision_of_poses = rankings.target_precision if accepts_poses else np.nan
        validation_precision = (precision_of_poses, *[np.nan] * (len(rankings.kinds) - 1))
    evaluations = {}
    for i, case in enumerate(cases):
        rows = slice(i * query_count, (i + 1) * query_count)
        estimates = None
        if isinstance(rankings, Fixes):
            kept = rankings.kept_precision()
            estimates = PoseEstimates(
                rankings.world_T_query[rows],
                rankings.reject_from(),
                rankings.right_within,
                rankings.covariance[rows],
                np.nan if kept is None else kept,
            )
        evaluation = judge(
            ranking=rankings.ranking(rows),
            reject_from=rankings.thresholds,
            labels=labels,
            world_T_anchor=submaps.world_T_anchor,
            distance=distance,
            bootstrap=bootstrap,
            turned_deg=rankings.turned_deg[rows],
            estimates=estimates,
        )
        evaluations[case] = replace(
            evaluation,
            claims=claims,
            unsuited=caveats,
            target_precision=rankings.target_precision,
            validation_precision=validation_precision,
        )
    return evaluations


def judge(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    distance: Distance,
    bootstrap: Bootstrap,
    turned_deg: NDArray[np.float32] | None = None,
    estimates: PoseEstimates | None = None,
) -> Evaluation:
    """Judge the ranking of q queries against their labels and true poses.

    `reject_from` (kind,) is the model's threshold on each kind of novelty. `world_T_anchor`
    (q, 4, 4) are the true poses. If a perturbation turned the robot on the spot, `turned_deg` (q,)
    is the angle to the left, which these poses do not contain. `estimates` are for a method with
    poses.

    What `judge_cases` knows of the whole sequence is left empty: `claims`, `unsuited`, and the
    target and validation precision.

    Raises InputError if ranking, labels and poses do not fit together.
    """
    _check(ranking, reject_from, labels, world_T_anchor)
    if estimates is None:
        missing = np.full(world_T_anchor.shape, np.nan)
        estimates = PoseEstimates(missing, np.nan, kept_precision=np.nan)
    queries = _queries(ranking, reject_from, labels, world_T_anchor, turned_deg, estimates)
    # An answer outside all places says: unseen. By cells such a query is always rejected.
    is_outside = ranking.places[:, :1] < 0
    queries_by_cells = replace(
        queries, novelty=np.where(is_outside, np.float32(np.inf), queries.novelty)
    )
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    ground_truth_by_cells = by_cells(ranking.places, labels.places, labels.oracle)
    ground_truth_by_distance = distance.ground_truth(ranking.xy_m, xy_m, labels.nearest_m)
    return Evaluation(
        judgements=(
            _judgement(ground_truth_by_cells, queries_by_cells, xy_m, bootstrap),
            _judgement(ground_truth_by_distance, queries, xy_m, bootstrap),
        ),
        **vars(queries),
        calibration=_calibration(ranking, labels),
        confidence=ranking.confidence,
        answer=ranking.places[:, 0],
        cost=ranking.costs[:, 0],
        xy_m=xy_m,
        answer_xy_m=ranking.xy_m[:, 0].astype(np.float64),
        kinds=ranking.kinds,
        days=labels.days,
        block_m=bootstrap.block_m,
        claims={},
        blind=blind(labels.places, labels.nearest_m, xy_m, distance),
        unsuited={},
        kept_precision=estimates.kept_precision,
        target_precision=np.nan,
        validation_precision=(np.nan,) * len(ranking.kinds),
    )


def _check(
    ranking: Ranking, reject_from: Sequence[float], labels: Labels, world_T_anchor: Poses
) -> None:
    """Raise InputError unless all have a row a query, and each kind of novelty a threshold."""
    answers = [array for name, array in vars(ranking).items() if name != "kinds"]
    ground_truths = (
        world_T_anchor,
        labels.places,
        labels.oracle,
        labels.nearest_m,
        labels.nearest_turn_deg,
    )
    rows = {len(array) for array in (*answers, *ground_truths)}
    if len(rows) != 1:
        raise InputError(
            f"the ranking and the labels must have one row a query, but have {sorted(rows)}"
        )
    if ranking.places.shape[1] == 0:
        raise InputError("a ranking must hold at least one place a query")
    if not ranking.novelty.shape[1] == len(ranking.kinds) == len(reject_from) > 0:
        raise InputError(
            f"{ranking.novelty.shape[1]} columns of novelty, {len(ranking.kinds)} kinds and "
            f"{len(reject_from)} thresholds"
        )


def _queries(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    turned_deg: NDArray[np.float32] | None,
    estimates: PoseEstimates,
) -> Queries:
    """The queries with the errors of their first answers, and of their estimated poses."""
    turn_deg = np.asarray(labels.nearest_turn_deg, np.float64)
    true_deg = np.rad2deg(yaw(world_T_anchor))
    world_T_query = world_T_anchor
    if turned_deg is not None:
        turn_deg = wrapped_deg(turn_deg + turned_deg)
        true_deg = true_deg + turned_deg
        world_T_query = world_T_anchor @ turns(np.deg2rad(turned_deg.astype(np.float64)))
    pose_error_m, pose_error_deg = distance_and_turn(estimates.world_T_query, world_T_query)
    answer_xy_m = ranking.xy_m[:, 0].astype(np.float64)
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    answer_deg = ranking.heading_deg[:, 0].astype(np.float64)
    return Queries(
        novelty=np.asarray(ranking.novelty, np.float32),
        reject_from=tuple(map(float, reject_from)),
        thresholds=even_thresholds(ranking.novelty[:, 0]),
        error_m=np.linalg.norm(answer_xy_m - xy_m, axis=1),
        turn_deg=turn_deg,
        nearest_m=np.asarray(labels.nearest_m, np.float64),
        heading_error_deg=np.abs(wrapped_deg(answer_deg - true_deg)),
        pose_error_m=pose_error_m,
        pose_error_deg=pose_error_deg,
        pose_square=estimates.squares(world_T_query),
        reject_pose_from=estimates.reject_from,
        right_within=estimates.right_within,
    )


def _judgement(
    ground_truth: GroundTruth, queries: Queries, xy_m: NDArray[np.float64], bootstrap: Bootstrap
) -> Judgement:
    """Judge queries at positions (q, 2) by one protocol."""
    kind_count = queries.novelty.shape[1]

    def every_number(weight: Weight) -> NDArray[np.float64]:
        """All NUMBERS, then MEASURES of each kind of novelty, with a column a resample."""
        in_use = numbers(ground_truth, queries, weight)
        values = [*in_use.values(), *(in_use[name] for name in MEASURES)]
        for kind in range(1, kind_count):
            values += measures(ground_truth, queries, kind, weight).values()
        return np.stack(values)

    estimates = bootstrap.estimates(every_number, xy_m)
    numbers_with_bounds = estimates[: len(NUMBERS)]
    measures_with_bounds = estimates[len(NUMBERS) :].reshape(kind_count, len(MEASURES), 3)

    once = np.ones((1, len(xy_m)))  # the weight if each query counts once
    recall_at = [
        share(is_right_at(ground_truth, n), ground_truth.seen, once) for n in range(1, TOP_N + 1)
    ]
    return Judgement(
        recall_at=np.concatenate(recall_at),
        true_rank=ground_truth.true_rank,
        seen=ground_truth.seen,
        unseen=ground_truth.unseen,
        outcome=outcomes(ground_truth, queries.novelty[:, 0], queries.reject_from[0]),
        oracle_right=ground_truth.oracle_right,
        numbers=numbers_with_bounds,
        rejection=measures_with_bounds,
    )


def outcomes(
    ground_truth: GroundTruth, novelty: NDArray[np.float32], threshold: float
) -> NDArray[np.int8]:
    """The outcome (q,) of each query at one threshold, from `TRUE_POSITIVE` to `NOT_JUDGED`.

    Only the first answer counts.
    """
    is_rejected = novelty.astype(np.float64) >= threshold
    if_accepted = np.where(is_right_at(ground_truth, 1), TRUE_POSITIVE, FALSE_POSITIVE)
    if_rejected = np.where(ground_truth.seen, FALSE_NEGATIVE, TRUE_NEGATIVE)
    if_judged = np.where(is_rejected, if_rejected, if_accepted)
    return np.where(ground_truth.seen | ground_truth.unseen, if_judged, NOT_JUDGED).astype(np.int8)


def _calibration(ranking: Ranking, labels: Labels) -> NDArray[np.float64]:
    """The expected calibration errors (2,) of 1 − cost and of the method's own confidence.

    They are over the seen queries, by cells. NaN where the method gives no confidence.
    """
    seen = labels.places >= 0
    confidence = ranking.confidence[seen]
    is_right = (ranking.places[:, 0] == labels.places)[seen]
    if not probabilities(confidence):
        return np.full(2, np.nan)
    return np.array([ece(1 - ranking.costs[seen, 0], is_right), ece(confidence, is_right)])
