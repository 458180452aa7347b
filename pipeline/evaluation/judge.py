"""Judges what a model answered: rankings, labels and true poses in; an `Evaluation` out.

By both protocols it has each query's outcome, and every number with its interval. `judge` takes one
case of a sequence's queries, `judge_cases` all of a sequence.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case, read_cases
from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, distance_and_turn, turns, wrapped_deg, yaw
from pipeline.core.schemas import Fixes, Labels, Rankings, SequenceRanking, Submaps
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.calibration import chances, ece
from pipeline.evaluation.counts import TOP_N, ExactCounts, count, even_thresholds, is_right_at
from pipeline.evaluation.curves import auc
from pipeline.evaluation.doubts import blind, unsuited
from pipeline.evaluation.judgement import (
    CORRECT_REJECTION,
    FALSE_ALARM,
    HIT,
    MISS,
    NOT_JUDGED,
    WEAKER_VERDICTS,
    Evaluation,
    Judgement,
)
from pipeline.evaluation.numbers import (
    MEASURES,
    NUMBERS,
    RIGHT_WITHIN,
    Queries,
    Weight,
    curve,
    measures,
    numbers,
    share,
    where,
)
from pipeline.evaluation.protocols import Distance, Truth, by_cells
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING


def judge(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    distance: Distance,
    bootstrap: Bootstrap,
    turned_deg: NDArray[np.float32] | None = None,
    world_T_query: Poses | None = None,
    reject_pose_from: float = np.nan,
    right_within: tuple[float, float] = RIGHT_WITHIN,
) -> Evaluation:
    """Judge a ranking of q queries against their labels and true poses (q, 4, 4).

    `reject_from` (kind,) is the model's threshold on each kind of novelty. `turned_deg` (q,) is how
    far the robot was turned to the left for each query; `world_T_anchor` are the poses before.
    Of a method with poses, `world_T_query` (q, 4, 4) are the estimated ones, `reject_pose_from` is
    the novelty from which to reject to keep .99 of them, and they are right within these metres and
    degrees. Raises InputError where ranking, labels and poses do not fit together.
    """
    _check(ranking, reject_from, labels, world_T_anchor)
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    queries = _queries(ranking, reject_from, labels, world_T_anchor, turned_deg)
    if world_T_query is not None:
        world_T_query_true = world_T_anchor
        if turned_deg is not None:
            world_T_query_true = world_T_anchor @ turns(np.deg2rad(turned_deg.astype(np.float64)))
        pose_error_m, pose_error_deg = distance_and_turn(world_T_query, world_T_query_true)
        queries = replace(queries, pose_error_m=pose_error_m, pose_error_deg=pose_error_deg)
    queries = replace(queries, reject_pose_from=reject_pose_from, right_within=right_within)
    # An answer outside all places says: unseen.
    is_outside = ranking.places[:, :1] < 0
    queries_by_cells = replace(
        queries, novelty=np.where(is_outside, np.float32(np.inf), queries.novelty)
    )
    truth_by_cells = by_cells(ranking.places, labels.places, labels.oracle)
    truth_by_distance = distance.truth(ranking.xy_m, xy_m, labels.nearest_m)
    return Evaluation(
        judgements=(
            _judgement(truth_by_cells, queries_by_cells, xy_m, bootstrap),
            _judgement(truth_by_distance, queries, xy_m, bootstrap),
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
        beliefs={},
        blind=blind(labels.places, labels.nearest_m, xy_m, distance),
        unsuited={},
        wanted_precision=np.nan,
        kept_precision=(np.nan,) * len(ranking.kinds),
    )


def _queries(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    turned_deg: NDArray[np.float32] | None,
) -> Queries:
    """The queries with their first answers' errors, as of a method without poses."""
    turn_deg = np.asarray(labels.nearest_turn_deg, np.float64)
    true_deg = np.rad2deg(yaw(world_T_anchor))
    if turned_deg is not None:
        turn_deg = wrapped_deg(turn_deg + turned_deg)
        true_deg = true_deg + turned_deg
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
        pose_error_m=np.full(len(xy_m), np.nan),
        pose_error_deg=np.full(len(xy_m), np.nan),
        reject_pose_from=np.nan,
        right_within=RIGHT_WITHIN,
    )


def judge_cases(
    rankings: SequenceRanking,
    labels: Labels,
    submaps: Submaps,
    distance: Distance,
    bootstrap: Bootstrap,
) -> dict[Case, Evaluation]:
    """Judge each case of the rankings of one sequence.

    Labels and submaps are those of the sequence as it was driven. Raises InputError where the
    rankings are not of these submaps in each case.
    """
    cases = read_cases(rankings.cases)
    n = len(submaps.world_T_anchor)
    if len(rankings.turned_deg) != n * len(cases):
        raise InputError(
            f"{rankings.path}: {len(rankings.turned_deg)} queries in {len(cases)} cases of {n} "
            "submaps"
        )
    evaluations = {}
    for i, case in enumerate(cases):
        rows = slice(i * n, (i + 1) * n)
        evaluation = judge(
            rankings.ranking(rows),
            rankings.thresholds,
            labels,
            submaps.world_T_anchor,
            distance,
            bootstrap,
            rankings.turned_deg[rows],
            rankings.world_T_query[rows] if isinstance(rankings, Fixes) else None,
            rankings.reject_from() if isinstance(rankings, Fixes) else np.nan,
            rankings.right_within if isinstance(rankings, Fixes) else RIGHT_WITHIN,
        )
        evaluations[case] = replace(
            evaluation,
            beliefs=_beliefs(rankings),
            unsuited=unsuited(submaps),
            wanted_precision=rankings.wanted_precision,
            kept_precision=kept_precision(rankings),
        )
    return evaluations


def kept_precision(rankings: SequenceRanking) -> tuple[float, ...]:
    """The precision that each threshold (kind,) keeps on held-out blocks.

    NaN where that is not known, or nothing is accepted. The verdict on poses, the first kind, keeps
    what is wanted or accepts nothing.
    """
    if isinstance(rankings, Rankings):
        return rankings.kept_precision
    accepts = rankings.thresholds[0] > ACCEPT_NOTHING
    of_poses = rankings.wanted_precision if accepts else np.nan
    return (of_poses, *[np.nan] * (len(rankings.kinds) - 1))


def _beliefs(rankings: SequenceRanking) -> dict[str, float]:
    """For each kind of WEAKER_VERDICTS the novelty from which to reject it to keep .99.

    Empty without poses.
    """
    if not isinstance(rankings, Fixes):
        return {}
    return {belief: rankings.reject_from(belief=belief) for belief in WEAKER_VERDICTS}


def _calibration(ranking: Ranking, labels: Labels) -> NDArray[np.float64]:
    """Expected calibration errors (2,) of 1 − cost and of the confidence, over the seen queries.

    By cells; NaN where the method gives no confidence.
    """
    seen = labels.places >= 0
    confidence = ranking.confidence[seen]
    is_right = (ranking.places[:, 0] == labels.places)[seen]
    if not chances(confidence):
        return np.full(2, np.nan)
    return np.array([ece(1 - ranking.costs[seen, 0], is_right), ece(confidence, is_right)])


def _judgement(
    truth: Truth, queries: Queries, xy_m: NDArray[np.float64], bootstrap: Bootstrap
) -> Judgement:
    """Judge the queries by one protocol; every number and its interval come from one function."""
    kinds = queries.novelty.shape[1]
    unit_weight = np.ones((1, len(xy_m)))
    novelty = queries.novelty[:, 0]

    def every_number(weight: Weight) -> NDArray[np.float64]:
        in_use = numbers(truth, queries, weight)
        measures_in_use = {name: in_use[name] for name in MEASURES}
        further_kinds = (measures(truth, queries, kind, weight) for kind in range(1, kinds))
        groups = (in_use, measures_in_use, *further_kinds)
        return np.stack([value for group in groups for value in group.values()])

    estimates = bootstrap.estimates(every_number, xy_m)
    counts = count(truth, novelty, queries.thresholds)
    seen = unit_weight @ truth.seen
    precision, recall = curve(truth, counts, seen)
    exact = ExactCounts(truth, novelty, unit_weight)
    areas = [auc(*curve(truth, exact.count(n), seen)) for n in range(1, TOP_N + 1)]
    return Judgement(
        **vars(counts),
        precision=precision,
        recall=recall,
        auc=where(seen, auc(precision, recall)),
        auc_exact=where(seen, np.concatenate(areas)),
        recall_at=np.concatenate(
            [share(is_right_at(truth, n), truth.seen, unit_weight) for n in range(1, TOP_N + 1)]
        ),
        true_rank=truth.true_rank,
        seen=truth.seen,
        unseen=truth.unseen,
        outcome=outcomes(truth, novelty, queries.reject_from[0]),
        oracle_right=truth.oracle_right,
        numbers=estimates[: len(NUMBERS)],
        rejection=estimates[len(NUMBERS) :].reshape(kinds, len(MEASURES), 3),
    )


def outcomes(truth: Truth, novelty: NDArray[np.float32], threshold: float) -> NDArray[np.int8]:
    """Outcome (q,) of each query at one threshold by its first answer: `HIT` to `NOT_JUDGED`."""
    rejected = novelty.astype(np.float64) >= threshold
    accepted_as = np.where(is_right_at(truth, 1), HIT, FALSE_ALARM)
    judged_as = np.where(rejected, np.where(truth.seen, MISS, CORRECT_REJECTION), accepted_as)
    return np.where(truth.seen | truth.unseen, judged_as, NOT_JUDGED).astype(np.int8)


def _check(
    ranking: Ranking, reject_from: Sequence[float], labels: Labels, world_T_anchor: Poses
) -> None:
    answers = [array for name, array in vars(ranking).items() if name != "kinds"]
    true = (world_T_anchor, labels.places, labels.oracle, labels.nearest_m, labels.nearest_turn_deg)
    rows = {len(array) for array in (*answers, *true)}
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
