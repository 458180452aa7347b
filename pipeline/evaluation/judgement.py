"""How a model fared in one test sequence, in each case of its queries.

Every dimension is kept, and the numbers have intervals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.errors import ArtifactError
from pipeline.evaluation.bootstrap import blocks
from pipeline.evaluation.counts import ExactCounts
from pipeline.evaluation.doubts import doubts
from pipeline.evaluation.numbers import MEASURES, NUMBERS, SAME_HEADING_DEG, curve, within
from pipeline.evaluation.protocols import PROTOCOLS, Truth
from pipeline.schemas import EVALUATIONS
from pipeline.store import Artifact

HIT, MISS, FALSE_ALARM, CORRECT_REJECTION, NOT_JUDGED = range(5)


@dataclass(frozen=True)
class Judgement:
    """Results by one protocol: the columns of an `evaluations` artifact with a row a protocol."""

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
    numbers: NDArray[np.float64]  # (number, 3)
    rejection: NDArray[np.float64]  # (kind, measure, 3)

    @property
    def answered(self) -> float:
        """The share of the judged queries that the method answers; 0 where none is judged."""
        return float(
            np.isin(self.outcome, (HIT, FALSE_ALARM)).sum()
            / max((self.outcome != NOT_JUDGED).sum(), 1)
        )

    def turned_share(self, turn_deg: NDArray[np.float64]) -> float:
        """The share of the seen queries that drive another way than training; NaN without any.

        `turn_deg` (q,) is their heading against that of training.
        """
        return (
            float((np.abs(turn_deg[self.seen]) > SAME_HEADING_DEG).mean())
            if self.seen.any()
            else np.nan
        )


@dataclass(frozen=True)
class Evaluation:
    """One model on the q queries of one case in one test sequence, at t thresholds.

    `schemas.EVALUATIONS` says what each array is.
    """

    cells: Judgement
    distance: Judgement
    thresholds: NDArray[np.float64]  # (t,)
    calibration: NDArray[np.float64]  # (2,)
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
    pose_error_m: NDArray[np.float64]  # (q,)
    pose_error_deg: NDArray[np.float64]  # (q,)
    kinds: tuple[str, ...]
    reject_from: tuple[float, ...]
    promised: float
    wanted: float
    """Precision that the thresholds were chosen for; NaN where it is not known."""
    kept: tuple[float, ...]
    """(kind,) precision that each keeps on held-out blocks of training; NaN where it is not known,
    or accepts nothing."""
    days: int
    blind: Mapping[str, float]
    block_m: float
    unsuited: Mapping[str, float]

    @property
    def fixes(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which poses (q,) are accepted with a promise of .99, and which are right."""
        right = within("within_2m_5deg", self.pose_error_m, self.pose_error_deg)
        return self.novelty[:, 0].astype(np.float64) < self.promised, right

    @property
    def belief(self) -> dict[str, int]:
        """How many answers are accepted and refused, and how many are wrong among each.

        Poses are accepted with a promise of .99, seen or not, and are wrong where over 2 m or 5°
        off; of a query without a pose nothing is wrong. Places are accepted at the threshold in
        use, of the queries judged by distance, and are wrong where they are over `correct_m` off.
        """
        judged = self.distance.outcome != NOT_JUDGED
        accepted = np.isin(self.distance.outcome, (HIT, FALSE_ALARM))
        wrong = judged & ~(self.distance.seen & (self.distance.true_rank == 0))
        if not np.isnan(self.promised):
            accepted, right = self.fixes
            judged = np.ones(len(right), bool)
            wrong = ~right & ~np.isnan(self.pose_error_m)
        refused = judged & ~accepted
        kinds = {
            "accepted": accepted,
            "accepted_wrong": accepted & wrong,
            "refused": refused,
            "refused_wrong": refused & wrong,
        }
        return {name: int(rows.sum()) for name, rows in kinds.items()}

    def protocol(self, name: str) -> Judgement:
        """The judgement by one of PROTOCOLS."""
        return {"cells": self.cells, "distance": self.distance}[name]

    def doubts(self, name: str) -> dict[str, float]:
        """Conditions by name under which the numbers by that protocol say little or nothing."""
        seen = self.protocol(name).seen
        blocks_with_seen = np.unique(blocks(self.xy_m, self.block_m)[seen])
        of_answers = doubts(
            self.blind[name],
            self.answer,
            self.novelty[:, 0],
            self.reject_from[0],
            self.kept[0],
            self.wanted,
            int(seen.sum()),
            len(blocks_with_seen),
        )
        return of_answers | dict(self.unsuited)

    def truth(self, name: str) -> Truth:
        """What that judgement took as true of the queries."""
        judgement = self.protocol(name)
        return Truth(
            judgement.seen,
            judgement.unseen,
            judgement.true_rank,
            judgement.oracle_right,
            usual_recall=name == "distance",
        )

    def number(self, protocol: str, name: str) -> tuple[float, float, float]:
        """One of NUMBERS and the bounds of its 95 % interval; NaN where there is none."""
        value, low, high = map(float, self.protocol(protocol).numbers[NUMBERS.index(name)])
        return value, low, high

    def exact_curve(self, protocol: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Precision and recall (n,) of the first answers at every distinct novelty in use.

        From none accepted to all.
        """
        truth = self.truth(protocol)
        unit_weight = np.ones((1, len(self.answer)))
        counts = ExactCounts(truth, self.novelty[:, 0], unit_weight).count(1)
        precision, recall = curve(truth, counts, unit_weight @ truth.seen)
        return precision[0], recall[0]

    @classmethod
    def read(cls, artifact: Artifact, case: int = 0) -> Self:
        """Read one case of an `evaluations` artifact; the first is as driven.

        Raises ArtifactError for an artifact of another version.
        """
        for name, expected in (
            ("protocols", PROTOCOLS),
            ("numbers", NUMBERS),
            ("measures", MEASURES),
        ):
            if tuple(artifact.attrs[name]) != expected:
                raise ArtifactError(
                    f"{artifact.path}: its {name} are not this version's; `dvc repro` it"
                )
        arrays = {name: np.asarray(artifact[name][case]) for name in EVALUATIONS.columns}
        parts: dict[str, Any] = {
            field.name: arrays[field.name] for field in fields(cls) if field.name in arrays
        }
        for i, name in enumerate(PROTOCOLS):
            parts[name] = Judgement(
                **{field.name: arrays[field.name][i] for field in fields(Judgement)}
            )
        promised = artifact.attrs["promised"]
        parts |= {
            "kinds": tuple(artifact.attrs["kinds"]),
            "reject_from": tuple(map(float, artifact.attrs["reject_from"])),
        }
        parts["promised"] = np.nan if promised is None else float(promised)
        parts["wanted"] = float(artifact.attrs["wanted_precision"])
        parts["kept"] = tuple(
            np.nan if precision is None else float(precision)
            for precision in artifact.attrs["kept_precision"]
        )
        parts["blind"] = {
            protocol: np.nan if share is None else float(share)
            for protocol, share in artifact.attrs["blind"].items()
        }
        parts["unsuited"] = artifact.attrs["unsuited"]
        block_m = float(artifact.attrs["bootstrap"]["block_m"])
        return cls(**parts, days=int(artifact.attrs["days"]), block_m=block_m)


def columns(evaluations: Sequence[Evaluation]) -> dict[str, NDArray[Any]]:
    """The arrays of an artifact that holds these evaluations, a row a case."""

    def rows(name: str) -> list[NDArray[Any]]:
        if name in {field.name for field in fields(Evaluation)}:
            return [getattr(evaluation, name) for evaluation in evaluations]
        return [
            np.stack([getattr(evaluation.protocol(protocol), name) for protocol in PROTOCOLS])
            for evaluation in evaluations
        ]

    return {name: np.stack(rows(name)) for name in EVALUATIONS.columns}


def attrs(evaluations: Mapping[Case, Evaluation]) -> dict[str, Any]:
    """The attributes of that artifact that the evaluations determine."""
    first = next(iter(evaluations.values()))
    names = {
        "protocols": list(PROTOCOLS),
        "numbers": list(NUMBERS),
        "measures": list(MEASURES),
        "kinds": list(first.kinds),
    }
    promised = None if np.isnan(first.promised) else first.promised
    measured = {
        "days": first.days,
        "reject_from": list(first.reject_from),
        "promised": promised,
        "blind": _valid(first.blind),
        "unsuited": dict(first.unsuited),
        "kept_precision": [None if np.isnan(precision) else precision for precision in first.kept],
    }
    return {"cases": [asdict(case) for case in evaluations], **measured, **names}


def summary(evaluation: Evaluation) -> dict[str, Any]:
    """All numbers of an evaluation by name, as JSON can hold them: None where there is none."""
    numbers: dict[str, Any] = {"days": evaluation.days, "queries": len(evaluation.answer)}
    for protocol in PROTOCOLS:
        judgement = evaluation.protocol(protocol)
        values = {name: evaluation.number(protocol, name)[0] for name in NUMBERS} | {
            "threshold": evaluation.reject_from[0]
        }
        counts = {"seen": int(judgement.seen.sum()), "unseen": int(judgement.unseen.sum())}
        numbers[protocol] = counts | _valid(values) | _valid(evaluation.doubts(protocol))
    numbers["calibration"] = _valid(
        dict(zip(("ece_raw", "ece"), map(float, evaluation.calibration), strict=True))
    )
    return numbers


def metrics(evaluation: Evaluation) -> dict[str, float]:
    """The few numbers that `dvc metrics show` has in the row of a model and sequence.

    auc_top1 is the SCI paper's, by cells; the others go by distance. Numbers that are not defined
    are left out.
    """
    shown = {
        "auc_top1": evaluation.number("cells", "auc_top1")[0],
        "recall_at_1": evaluation.number("distance", "recall_at_1")[0],
        "answered": evaluation.distance.answered,
        "right_of_answered": evaluation.number("distance", "precision_at_threshold")[0],
        "kept_precision": evaluation.kept[0],
        "within_2m_5deg": evaluation.number("distance", "within_2m_5deg")[0],
    }
    return {name: value for name, value in shown.items() if np.isfinite(value)}


def _valid(numbers: Mapping[str, float]) -> dict[str, float | None]:
    return {
        name: number if abs(number) < np.finfo(np.float64).max else None
        for name, number in numbers.items()
    }
