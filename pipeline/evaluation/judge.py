"""Judges a ranking: what became of each query by both protocols, and every number with its 95 %
interval."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case, read_cases
from pipeline.errors import InputError
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.calibration import chances, ece
from pipeline.evaluation.counts import TOP_N, ExactCounts, count, right, spread
from pipeline.evaluation.curves import auc
from pipeline.evaluation.doubts import blind, unsuited
from pipeline.evaluation.judgement import (
    CORRECT_REJECTION,
    FALSE_ALARM,
    HIT,
    MISS,
    NOT_JUDGED,
    Evaluation,
    Judgement,
)
from pipeline.evaluation.numbers import (
    MEASURES,
    NUMBERS,
    Queries,
    Weight,
    curve,
    measures,
    numbers,
    share,
    where,
)
from pipeline.evaluation.protocols import Distance, Truth, by_cells
from pipeline.frames import Poses, apart, turns, wrapped_deg, yaw
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.schemas import LABELS
from pipeline.store import Artifact


def judge(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    days: int,
    distance: Distance,
    bootstrap: Bootstrap,
    turned_deg: NDArray[np.float32] | None = None,
    world_T_query: Poses | None = None,
    promised: float = np.nan,
) -> Evaluation:
    """Judge a ranking of q queries against their labels and poses (q, 4, 4) as they were driven,
    rows in that order.

    `reject_from` is the model's threshold on each kind of novelty; `days` are since training;
    `turned_deg` (q,) is how far the robot was turned to the left for each query; `world_T_query`
    (q, 4, 4) are poses as estimated, and `promised` the novelty to reject from to keep .99 of them.
    Raises InputError where ranking, labels and poses do not fit together.
    """
    _check(ranking, reject_from, labels, world_T_anchor)
    turn_deg = np.asarray(labels.nearest_turn_deg, np.float64)
    true_deg = np.rad2deg(yaw(world_T_anchor))
    if turned_deg is not None:
        turn_deg = wrapped_deg(turn_deg + turned_deg)
        true_deg = true_deg + turned_deg
    answer_xy_m = ranking.xy_m[:, 0].astype(np.float64)
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    none = np.full(len(xy_m), np.nan)
    standing = world_T_anchor
    if turned_deg is not None:
        standing = world_T_anchor @ turns(np.deg2rad(turned_deg.astype(np.float64)))
    pose_error_m, pose_error_deg = (
        (none, none) if world_T_query is None else apart(world_T_query, standing)
    )
    queries = Queries(
        novelty=np.asarray(ranking.novelty, np.float32),
        reject_from=tuple(map(float, reject_from)),
        thresholds=spread(ranking.novelty[:, 0]),
        error_m=np.linalg.norm(answer_xy_m - xy_m, axis=1),
        turn_deg=turn_deg,
        nearest_m=np.asarray(labels.nearest_m, np.float64),
        heading_error_deg=np.abs(
            wrapped_deg(ranking.heading_deg[:, 0].astype(np.float64) - true_deg)
        ),
        pose_error_m=pose_error_m,
        pose_error_deg=pose_error_deg,
        promised=promised,
    )
    placed = np.where(
        ranking.places[:, :1] < 0, np.float32(np.inf), queries.novelty
    )  # an answer outside all places says: unseen
    return Evaluation(
        cells=_judgement(
            by_cells(ranking.places, labels.places, labels.oracle),
            replace(queries, novelty=placed),
            xy_m,
            bootstrap,
        ),
        distance=_judgement(
            distance.truth(ranking.xy_m, xy_m, labels.nearest_m), queries, xy_m, bootstrap
        ),
        **vars(queries),
        calibration=_calibration(ranking, labels),
        confidence=ranking.confidence,
        answer=ranking.places[:, 0],
        cost=ranking.costs[:, 0],
        xy_m=xy_m,
        answer_xy_m=answer_xy_m,
        kinds=ranking.kinds,
        days=days,
        block_m=bootstrap.block_m,
        blind=blind(labels.places, labels.nearest_m, xy_m, distance),
        unsuited={},
        wanted=np.nan,
        kept=(np.nan,) * len(ranking.kinds),
    )


def judge_cases(
    rankings: Artifact,
    labels: Artifact,
    submaps: Artifact,
    distance: Distance,
    bootstrap: Bootstrap,
) -> dict[Case, Evaluation]:
    """Judge each case of the rankings of one sequence; labels and submaps are those of the sequence
    as it was driven.

    Raises InputError where the rankings are not of these submaps in each case.
    """
    true = Labels(**{name: labels.load(name) for name in LABELS.columns})
    world_T_anchor = submaps.load("world_T_anchor")
    days = int(labels.attrs["days"])
    found = {}
    cases = read_cases(rankings.attrs)
    n = len(world_T_anchor)
    arrays = {
        name: rankings.load(name)
        for name in [field.name for field in fields(Ranking) if field.name != "kinds"]
    }
    turned_deg = rankings.load("turned_deg")
    kinds = tuple(rankings.attrs["kinds"])
    posed = "promised" in rankings.attrs
    if len(turned_deg) != n * len(cases):
        raise InputError(
            f"{rankings.path}: {len(turned_deg)} queries in {len(cases)} cases of {n} submaps"
        )
    for i, case in enumerate(cases):
        own = slice(i * n, (i + 1) * n)
        ranking = Ranking(**{name: array[own] for name, array in arrays.items()}, kinds=kinds)
        given = (
            ranking,
            rankings.attrs["thresholds"],
            true,
            world_T_anchor,
            days,
            distance,
            bootstrap,
            turned_deg[own],
        )
        poses = (
            (np.asarray(rankings["world_T_query"][own]), float(rankings.attrs["promised"][1]))
            if posed
            else ()
        )
        wanted = float(rankings.attrs["wanted_precision"])
        kept = kept_precision(rankings)
        found[case] = replace(
            judge(*given, *poses), unsuited=unsuited(submaps), wanted=wanted, kept=kept
        )
    return found


def kept_precision(rankings: Artifact) -> tuple[float, ...]:
    """What each threshold (kind,) keeps on held-out blocks; NaN where that is not known, or nothing
    is accepted.

    The verdict on poses, the first kind, keeps what is wanted or accepts nothing.
    """
    told = rankings.attrs.get("kept_precision")
    if told is None:
        accepts = rankings.attrs["thresholds"][0] > ACCEPT_NOTHING
        told = [rankings.attrs["wanted_precision"] if accepts else None] + [None] * (
            len(rankings.attrs["kinds"]) - 1
        )
    return tuple(np.nan if one is None else float(one) for one in told)


def _calibration(ranking: Ranking, labels: Labels) -> NDArray[np.float64]:
    """Expected calibration error of 1 − cost and of the confidence, by cells, over the seen
    queries; NaN without a confidence."""
    seen = labels.places >= 0
    confidence = ranking.confidence[seen]
    right_there = (ranking.places[:, 0] == labels.places)[seen]
    if not chances(confidence):
        return np.full(2, np.nan)
    return np.array([ece(1 - ranking.costs[seen, 0], right_there), ece(confidence, right_there)])


def _judgement(
    truth: Truth, queries: Queries, xy_m: NDArray[np.float64], bootstrap: Bootstrap
) -> Judgement:
    """By one protocol; the numbers run through one function, with weights of one and with the
    bootstrap's."""
    kinds = queries.novelty.shape[1]
    everyone = np.ones((1, len(xy_m)))
    novelty = queries.novelty[:, 0]

    def every_number(weight: Weight) -> NDArray[np.float64]:
        first = numbers(truth, queries, weight)
        others = (measures(truth, queries, kind, weight) for kind in range(1, kinds))
        every = (first, {name: first[name] for name in MEASURES}, *others)
        return np.stack([value for found in every for value in found.values()])

    found = bootstrap.estimates(every_number, xy_m)
    counts = count(truth, novelty, queries.thresholds)
    seen = everyone @ truth.seen
    precision, recall = curve(truth, counts, seen)
    exact = ExactCounts(truth, novelty, everyone)
    areas = [auc(*curve(truth, exact.count(n), seen)) for n in range(1, TOP_N + 1)]
    return Judgement(
        **vars(counts),
        precision=precision,
        recall=recall,
        auc=where(seen, auc(precision, recall)),
        auc_exact=where(seen, np.concatenate(areas)),
        recall_at=np.concatenate(
            [share(right(truth, n), truth.seen, everyone) for n in range(1, TOP_N + 1)]
        ),
        true_rank=truth.true_rank,
        seen=truth.seen,
        unseen=truth.unseen,
        outcome=outcomes(truth, novelty, queries.reject_from[0]),
        oracle_right=truth.oracle_right,
        numbers=found[: len(NUMBERS)],
        rejection=found[len(NUMBERS) :].reshape(kinds, len(MEASURES), 3),
    )


def outcomes(truth: Truth, novelty: NDArray[np.float32], threshold: float) -> NDArray[np.int8]:
    """What becomes of each query (q,) at one threshold, looking at its first answer only: 0 to 4 as
    `HIT` … name them."""
    rejected = novelty.astype(np.float64) >= threshold
    accepted_as = np.where(right(truth, 1), HIT, FALSE_ALARM)
    judged = np.where(rejected, np.where(truth.seen, MISS, CORRECT_REJECTION), accepted_as)
    return np.where(truth.seen | truth.unseen, judged, NOT_JUDGED).astype(np.int8)


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
