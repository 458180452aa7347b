"""How a method fared in one test sequence: every dimension kept, and the few numbers that are shown of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.evaluation.counts import TOP_N, count, spread
from pipeline.evaluation.curves import auc, precision_recall

HIT, MISS, FALSE_ALARM, CORRECT_REJECTION = range(4)
SAME_HEADING_DEG = 45.0
"""Turned less than this against the nearest training anchor, a query drives the street as training did."""


@dataclass(frozen=True)
class Judgement:
    """The arrays of an `evaluations` artifact (schemas.EVALUATIONS says what each is), q queries at t thresholds."""

    thresholds: NDArray[np.float64]  # (t,)
    hits: NDArray[np.int64]  # (top_n, t)
    misses: NDArray[np.int64]  # (top_n, t)
    false_alarms: NDArray[np.int64]  # (top_n, t)
    correct_rejections: NDArray[np.int64]  # (top_n, t)
    precision: NDArray[np.float64]  # (top_n, t)
    recall: NDArray[np.float64]  # (top_n, t)
    auc: NDArray[np.float64]  # (top_n,)
    true_rank: NDArray[np.int64]  # (q,)
    seen: NDArray[np.bool_]  # (q,)
    novelty: NDArray[np.float32]  # (q,)
    outcome: NDArray[np.int8]  # (q,)
    xy_m: NDArray[np.float64]  # (q, 2)
    error_m: NDArray[np.float64]  # (q,)
    turn_deg: NDArray[np.float64]  # (q,)
    oracle_right: NDArray[np.bool_]  # (q,)


def judge(
    places: NDArray[np.int64],
    answers_xy_m: NDArray[np.float64],
    novelty: NDArray[np.float32],
    true_places: NDArray[np.int64],
    world_T_anchor: NDArray[np.float64],
    oracle: NDArray[np.int64],
    turn_deg: NDArray[np.float64],
    threshold: float,
    thresholds: NDArray[np.float64] | None = None,
) -> Judgement:
    """Judge a ranking, `places` (q, k) cheapest first with `answers_xy_m` (q, k, 2) and `novelty` (q,), against the truth.

    The truth is `true_places` (q,), −1 where training never went; the queries' poses (q, 4, 4); and `oracle` and `turn_deg`
    (q,), the place of the nearest training anchor and the heading against it. `threshold` is the model's own, for the
    outcomes; `thresholds` are the curve's, by default `counts.spread`.
    """
    rows = {len(a) for a in (places, answers_xy_m, novelty, true_places, world_T_anchor, oracle, turn_deg)}
    if len(rows) != 1:
        raise InputError(f"the ranking and the labels must have one row a query, but have {sorted(rows)}")
    if places.shape[1] == 0:
        raise InputError("a ranking must hold at least one place a query")
    novelty = np.asarray(novelty, np.float32)
    seen = true_places >= 0
    true_rank = rank_of(true_places, places)
    thresholds = spread(novelty) if thresholds is None else np.asarray(thresholds, np.float64)
    counts = count(true_rank, seen, novelty, thresholds, TOP_N)
    precision, recall = precision_recall(counts)
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    return Judgement(
        thresholds=thresholds,
        **vars(counts),
        precision=precision,
        recall=recall,
        auc=auc(precision, recall),
        true_rank=true_rank,
        seen=seen,
        novelty=novelty,
        outcome=outcomes(true_rank, seen, novelty, threshold),
        xy_m=xy_m,
        error_m=np.linalg.norm(answers_xy_m[:, 0].astype(np.float64) - xy_m, axis=1),
        turn_deg=np.asarray(turn_deg, np.float64),
        oracle_right=seen & (oracle == true_places),
    )


def rank_of(true_places: NDArray[np.int64], places: NDArray[np.int64]) -> NDArray[np.int64]:
    """0-based rank (q,) of each true place (q,) in `places` (q, k); −1 if it is not there or the query is unseen."""
    same = (places == true_places[:, None]) & (true_places >= 0)[:, None]
    return np.where(same.any(axis=1), same.argmax(axis=1), -1)


def outcomes(
    true_rank: NDArray[np.int64], seen: NDArray[np.bool_], novelty: NDArray[np.float32], threshold: float
) -> NDArray[np.int8]:
    """What becomes of each query (q,) at one threshold, looking at its first place only: 0 to 3 as `HIT` … name them."""
    rejected = novelty.astype(np.float64) >= threshold
    accepted_as = np.where(seen & (true_rank == 0), HIT, FALSE_ALARM)
    return np.where(rejected, np.where(seen, MISS, CORRECT_REJECTION), accepted_as).astype(np.int8)


def summary(judgement: Judgement, threshold: float, days: int) -> dict[str, float | None]:
    """The numbers of metrics.json; None where no query is there to speak of, so the file is valid JSON.

    `top…` and `oracle…` are shares of the seen queries, rejection ignored; precision and recall are at the model's threshold.
    """
    j, top1 = judgement, judgement.true_rank == 0
    same = j.seen & (np.abs(j.turn_deg) <= SAME_HEADING_DEG)
    turned = j.seen & ~same
    hits, misses, false_alarms, _ = np.bincount(j.outcome, minlength=4).tolist()
    return {
        "days": days,
        "queries": len(j.seen),
        "seen": int(j.seen.sum()),
        "unseen": int((~j.seen).sum()),
        **{f"auc_top{n}": float(j.auc[n - 1]) for n in (1, 5, 25)},
        **{f"top{n}": _share((j.true_rank >= 0) & (j.true_rank < n), j.seen) for n in (1, 5, 25)},
        "top1_same_heading": _share(top1, same),
        "top1_turned": _share(top1, turned),
        "oracle_top1": _share(j.oracle_right, j.seen),
        "oracle_top1_same_heading": _share(j.oracle_right, same),
        "oracle_top1_turned": _share(j.oracle_right, turned),
        "threshold": float(threshold) if np.isfinite(threshold) else None,
        "precision_at_threshold": hits / (hits + false_alarms) if hits + false_alarms else None,
        "recall_at_threshold": hits / (hits + misses) if hits + misses else 0.0,
        "median_error_m": _finite(float(np.median(j.error_m[j.seen]))) if j.seen.any() else None,
    }


def _share(flags: NDArray[np.bool_], among: NDArray[np.bool_]) -> float | None:
    """The share of `flags` (q,) among some of the queries (q,)."""
    return float(flags[among].mean()) if among.any() else None


def _finite(number: float) -> float | None:
    return number if np.isfinite(number) else None
