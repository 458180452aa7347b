"""How a method fared in one test sequence: every dimension kept, and the few numbers that are shown of it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ArtifactError, InputError
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.calibration import chances, ece
from pipeline.evaluation.counts import TOP_N, ExactCounts, count, right, spread
from pipeline.evaluation.curves import auc
from pipeline.evaluation.numbers import MEASURES, NUMBERS, Queries, Weight, curve, measures, numbers, share, where
from pipeline.evaluation.protocols import PROTOCOLS, Distance, Truth, by_cells
from pipeline.frames import Poses, yaw
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Ranking
from pipeline.schemas import EVALUATIONS
from pipeline.store import Artifact

HIT, MISS, FALSE_ALARM, CORRECT_REJECTION, NOT_JUDGED = range(5)


@dataclass(frozen=True)
class Judgement:
    """By one protocol: the columns of an `evaluations` artifact whose first dimension is the protocol."""

    hits: NDArray[np.int64]  # (top_n, t)
    misses: NDArray[np.int64]  # (top_n, t)
    false_alarms: NDArray[np.int64]  # (top_n, t)
    correct_rejections: NDArray[np.int64]  # (top_n, t)
    precision: NDArray[np.float64]  # (top_n, t)
    recall: NDArray[np.float64]  # (top_n, t)
    auc: NDArray[np.float64]  # (top_n,)
    auc_exact: NDArray[np.float64]  # (top_n,)
    recall_at: NDArray[np.float64]  # (top_n,)
    true_rank: NDArray[np.int64]  # (q,)
    seen: NDArray[np.bool_]  # (q,)
    unseen: NDArray[np.bool_]  # (q,)
    outcome: NDArray[np.int8]  # (q,)
    oracle_right: NDArray[np.bool_]  # (q,)
    interval: NDArray[np.float64]  # (number, 2)
    rejection: NDArray[np.float64]  # (kind, measure, 3)


@dataclass(frozen=True)
class Evaluation:
    """One method in one test sequence (schemas.EVALUATIONS says what each array is), q queries at t thresholds."""

    cells: Judgement
    distance: Judgement
    thresholds: NDArray[np.float64]  # (t,)
    novelty: NDArray[np.float32]  # (q, kind)
    confidence: NDArray[np.float32]  # (q,)
    answer: NDArray[np.int64]  # (q,)
    cost: NDArray[np.float32]  # (q,)
    xy_m: NDArray[np.float64]  # (q, 2)
    answer_xy_m: NDArray[np.float64]  # (q, 2)
    error_m: NDArray[np.float64]  # (q,)
    heading_error_deg: NDArray[np.float64]  # (q,)
    nearest_m: NDArray[np.float64]  # (q,)
    turn_deg: NDArray[np.float64]  # (q,)
    kinds: tuple[str, ...]
    reject_from: tuple[float, ...]
    days: int

    def protocol(self, name: str) -> Judgement:
        """The judgement by one of PROTOCOLS."""
        return {"cells": self.cells, "distance": self.distance}[name]

    def truth(self, name: str) -> Truth:
        """What that judgement took as true of the queries."""
        by = self.protocol(name)
        return Truth(by.seen, by.unseen, by.true_rank, by.oracle_right, usual_recall=name == "distance")

    @property
    def queries(self) -> Queries:
        """What its numbers are made of besides the truth."""
        return Queries(**{field.name: getattr(self, field.name) for field in fields(Queries)})

    def columns(self) -> dict[str, NDArray[Any]]:
        """The arrays of its artifact."""
        both = [self.protocol(name) for name in PROTOCOLS]
        return {
            name: np.stack([getattr(one, name) for one in both]) if column.dims[0] == "protocol" else getattr(self, name)
            for name, column in EVALUATIONS.columns.items()
        }

    def attrs(self) -> dict[str, Any]:
        """The attributes of its artifact that it knows."""
        names = {"protocols": list(PROTOCOLS), "numbers": list(NUMBERS), "measures": list(MEASURES), "kinds": list(self.kinds)}
        return {"days": self.days, "reject_from": list(self.reject_from), **names}

    @classmethod
    def read(cls, artifact: Artifact) -> Self:
        """From an `evaluations` artifact."""
        for name, expected in (("protocols", PROTOCOLS), ("numbers", NUMBERS), ("measures", MEASURES)):
            if tuple(artifact.attrs[name]) != expected:
                raise ArtifactError(f"{artifact.path}: its {name} are not today's; `dvc repro` it")
        arrays = {name: artifact.load(name) for name in EVALUATIONS.columns}
        own: dict[str, Any] = {field.name: arrays[field.name] for field in fields(cls) if field.name in arrays}
        for i, name in enumerate(PROTOCOLS):
            own[name] = Judgement(**{field.name: arrays[field.name][i] for field in fields(Judgement)})
        own |= {"kinds": tuple(artifact.attrs["kinds"]), "reject_from": tuple(map(float, artifact.attrs["reject_from"]))}
        return cls(**own, days=int(artifact.attrs["days"]))


def judge(
    ranking: Ranking,
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    days: int,
    distance: Distance,
    bootstrap: Bootstrap,
) -> Evaluation:
    """Judge a ranking of q queries against their labels and poses (q, 4, 4), rows in the order they were driven.

    `reject_from` is the model's threshold on each kind of novelty; `days` are since training.
    """
    queries = asked(ranking, reject_from, labels, world_T_anchor)
    xy_m = world_T_anchor[:, :2, 3].astype(np.float64)
    return Evaluation(
        cells=_judgement(by_cells(ranking.places, labels.places, labels.oracle), queries, xy_m, bootstrap),
        distance=_judgement(distance.truth(ranking.xy_m, xy_m, labels.nearest_m), queries, xy_m, bootstrap),
        **vars(queries),
        confidence=ranking.confidence,
        answer=ranking.places[:, 0],
        cost=ranking.costs[:, 0],
        xy_m=xy_m,
        answer_xy_m=ranking.xy_m[:, 0].astype(np.float64),
        kinds=ranking.kinds,
        days=days,
    )


def asked(ranking: Ranking, reject_from: Sequence[float], labels: Labels, world_T_anchor: Poses) -> Queries:
    """What a ranking said of q queries at poses (q, 4, 4), and what it is weighed by whatever the protocol.

    Raises InputError where ranking, labels and poses do not fit together.
    """
    _check(ranking, reject_from, labels, world_T_anchor)
    xy_m, answer_xy_m = world_T_anchor[:, :2, 3].astype(np.float64), ranking.xy_m[:, 0].astype(np.float64)
    off_deg = ranking.heading_deg.astype(np.float64) - np.rad2deg(yaw(world_T_anchor))
    return Queries(
        novelty=np.asarray(ranking.novelty, np.float32),
        reject_from=tuple(map(float, reject_from)),
        thresholds=spread(ranking.novelty[:, 0]),
        error_m=np.linalg.norm(answer_xy_m - xy_m, axis=1),
        turn_deg=np.asarray(labels.nearest_turn_deg, np.float64),
        nearest_m=np.asarray(labels.nearest_m, np.float64),
        heading_error_deg=np.abs(180 - (180 - off_deg) % 360),
    )


def _judgement(truth: Truth, queries: Queries, xy_m: NDArray[np.float64], bootstrap: Bootstrap) -> Judgement:
    """By one protocol; the numbers run through one function, with weights of one and with the bootstrap's."""
    kinds, everyone, novelty = queries.novelty.shape[1], np.ones((1, len(xy_m))), queries.novelty[:, 0]

    def told(weight: Weight) -> NDArray[np.float64]:
        first = numbers(truth, queries, weight)
        others = (measures(truth, queries, kind, weight) for kind in range(1, kinds))
        every = (first, {name: first[name] for name in MEASURES}, *others)
        return np.stack([value for found in every for value in found.values()])

    bounds = bootstrap.intervals(told, xy_m)
    of_kinds = np.concatenate([told(everyone), bounds], axis=1)[len(NUMBERS) :]
    counts, seen = count(truth, novelty, queries.thresholds), everyone @ truth.seen
    precision, recall = curve(truth, counts, seen)
    exact = ExactCounts(truth, novelty, everyone)
    areas = [auc(*curve(truth, exact.count(n), seen)) for n in range(1, TOP_N + 1)]
    return Judgement(
        **vars(counts),
        precision=precision,
        recall=recall,
        auc=where(seen, auc(precision, recall)),
        auc_exact=where(seen, np.concatenate(areas)),
        recall_at=np.concatenate([share(right(truth, n), truth.seen, everyone) for n in range(1, TOP_N + 1)]),
        true_rank=truth.true_rank,
        seen=truth.seen,
        unseen=truth.unseen,
        outcome=outcomes(truth, novelty, queries.reject_from[0]),
        oracle_right=truth.oracle_right,
        interval=bounds[: len(NUMBERS)],
        rejection=of_kinds.reshape(kinds, len(MEASURES), 3),
    )


def outcomes(truth: Truth, novelty: NDArray[np.float32], threshold: float) -> NDArray[np.int8]:
    """What becomes of each query (q,) at one threshold, looking at its first answer only: 0 to 4 as `HIT` … name them."""
    rejected = novelty.astype(np.float64) >= threshold
    accepted_as = np.where(right(truth, 1), HIT, FALSE_ALARM)
    judged = np.where(rejected, np.where(truth.seen, MISS, CORRECT_REJECTION), accepted_as)
    return np.where(truth.seen | truth.unseen, judged, NOT_JUDGED).astype(np.int8)


def summary(evaluation: Evaluation) -> dict[str, Any]:
    """The numbers of metrics.json; None where there is none, so the file is valid JSON."""
    everyone = np.ones((1, len(evaluation.answer)))
    told: dict[str, Any] = {"days": evaluation.days, "queries": len(evaluation.answer)}
    for name in PROTOCOLS:
        truth = evaluation.truth(name)
        found = {number: value.item() for number, value in numbers(truth, evaluation.queries, everyone).items()}
        found["threshold"] = evaluation.reject_from[0]
        told[name] = {"seen": int(truth.seen.sum()), "unseen": int(truth.unseen.sum())} | _valid(found)
    seen = evaluation.cells.seen
    confidence, answered = evaluation.confidence[seen], evaluation.cells.true_rank[seen] == 0
    errors = {"ece_raw": ece(1 - evaluation.cost[seen], answered), "ece": ece(confidence, answered)}
    told["calibration"] = _valid(errors if chances(confidence) else dict.fromkeys(errors, np.nan))
    return told


def _valid(numbers: dict[str, float]) -> dict[str, float | None]:
    return {name: number if abs(number) < np.finfo(np.float64).max else None for name, number in numbers.items()}


def _check(ranking: Ranking, reject_from: Sequence[float], labels: Labels, world_T_anchor: Poses) -> None:
    told = (ranking.places, ranking.costs, ranking.xy_m, ranking.novelty, ranking.confidence, ranking.heading_deg)
    true = (world_T_anchor, labels.places, labels.oracle, labels.nearest_m, labels.nearest_turn_deg)
    rows = {len(array) for array in (*told, *true)}
    if len(rows) != 1:
        raise InputError(f"the ranking and the labels must have one row a query, but have {sorted(rows)}")
    if ranking.places.shape[1] == 0:
        raise InputError("a ranking must hold at least one place a query")
    if not ranking.novelty.shape[1] == len(ranking.kinds) == len(reject_from) > 0:
        raise InputError(
            f"{ranking.novelty.shape[1]} columns of novelty, {len(ranking.kinds)} kinds and {len(reject_from)} thresholds"
        )
