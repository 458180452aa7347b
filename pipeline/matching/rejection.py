"""Chooses the threshold on novelty from which a query is rejected as unseen.

A model stores `NoveltyEvidence`: the novelty of the queries of validation blocks of the training
path, and whether it answered them right. From this evidence, `Rejection` chooses for each kind of
novelty the largest threshold that reaches a target precision among the accepted queries. No test
sequence is used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Share, checked
from pipeline.matching.ranking import Model, Ranking

ACCEPT_NOTHING = float(np.finfo(np.float32).min)
"""The threshold that rejects every query: no float32 novelty lies below it."""
VALIDATION = "validation/"
"""Prefix of the evidence within a model."""
LEAST_BLOCKS = 10
"""How many validation blocks a threshold must accept at least if it misses the target precision:
the best of many thresholds on fewer blocks would be luck."""


class Threshold(NamedTuple):
    """A threshold on one kind of novelty, chosen on validation blocks."""

    reject_from: float
    """Novelty from which queries are rejected; ACCEPT_NOTHING if no threshold can be chosen."""
    validation_precision: float
    """Precision among the accepted queries of these blocks, with one false positive added; NaN if
    no query is accepted."""


@dataclass(frozen=True)
class NoveltyEvidence:
    """A model's results on h queries from validation blocks, each of which was ranked twice.

    The first ranking is with the whole database, and simulates a query from a seen place. The
    second ranking is without the places around the query, and simulates a novel place.
    """

    right: NDArray[np.bool_]
    """(h,) whether the first ranking began with the true place."""
    seen: Mapping[str, NDArray[np.float64]]
    """For each kind of novelty, its values (h,) in the first ranking."""
    unseen: Mapping[str, NDArray[np.float64]]
    """For each kind of novelty, its values (h,) in the second ranking."""
    block: NDArray[np.int64]
    """(h,) the number of each query's block, from 0. Queries of one block are not independent."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The evidence's arrays, as they are stored in a model."""
        parts: dict[str, NDArray[Any]] = {
            f"{VALIDATION}right": self.right,
            f"{VALIDATION}block": self.block,
        }
        for kind, values in self.seen.items():
            parts[f"{VALIDATION}seen/{kind}"] = values.astype(np.float32)
        for kind, values in self.unseen.items():
            parts[f"{VALIDATION}unseen/{kind}"] = values.astype(np.float32)
        return parts

    @classmethod
    def of(cls, model: Model) -> Self:
        """Read the evidence in a model; raises InputError if it, or its blocks, are missing."""
        if VALIDATION + "right" not in model:
            raise InputError(
                f"the model has no {VALIDATION}right: a method must store its evidence of "
                "validation blocks"
            )
        if VALIDATION + "block" not in model:
            raise InputError(
                f"the model has no {VALIDATION}block: an earlier version made it; train it again"
            )
        return cls(
            model[VALIDATION + "right"].astype(bool),
            _by_kind(model, f"{VALIDATION}seen/"),
            _by_kind(model, f"{VALIDATION}unseen/"),
            model[VALIDATION + "block"].astype(np.int64),
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The evidence of several models with the same kinds of novelty, as one."""
        right = np.concatenate([part.right for part in parts])
        seen = {kind: np.concatenate([part.seen[kind] for part in parts]) for kind in parts[0].seen}
        unseen = {
            kind: np.concatenate([part.unseen[kind] for part in parts]) for kind in parts[0].unseen
        }
        blocks = []
        first_block = 0
        for part in parts:
            blocks.append(part.block + first_block)
            first_block += part.block.max(initial=-1) + 1
        return cls(right, seen, unseen, np.concatenate(blocks))

    @property
    def blocks(self) -> int:
        """The number of validation blocks."""
        return len(np.unique(self.block))

    def queries(
        self, kind: str, unseen_share: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Novelty, right and weight of the 2 h rankings, for this share of unseen queries.

        Rankings of seen places come first.
        """
        novelty = np.concatenate([self.seen[kind], self.unseen[kind]])
        right = np.concatenate([self.right, np.zeros_like(self.right)])
        return novelty, right, np.repeat([1 - unseen_share, unseen_share], len(self.right))

    def threshold(self, kind: str, unseen_share: float, target_precision: float) -> Threshold:
        """Choose the threshold on one kind of novelty; every block has the same weight."""
        novelty, right, weight = self.queries(kind, unseen_share)
        weight_in_block = 1 / np.bincount(self.block)[self.block]
        return reachable_threshold(
            target_precision,
            novelty,
            right,
            weight=weight * np.tile(weight_in_block, 2),
            block=np.tile(self.block, 2),
        )


def _by_kind(model: Model, prefix: str) -> dict[str, NDArray[np.float64]]:
    """The arrays of a model whose names begin with `prefix`, by the rest of their names."""
    return {
        name.removeprefix(prefix): model[name].astype(np.float64)
        for name in model
        if name.startswith(prefix)
    }


def is_near(
    query_m: NDArray[np.float64], database_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.bool_]:
    """True (h, m) where a row of the database (m, 2) lies nearer than `radius_m` to a query (h, 2).

    If all rows are near a query, they all count as far, so that it can be compared with some row.
    """
    is_close = np.linalg.norm(database_m - query_m[:, None], axis=2) < radius_m
    return np.asarray(is_close & ~is_close.all(axis=1, keepdims=True))


@dataclass(frozen=True)
@checked("rejection")
class Rejection:
    """The settings of rejection: which novelty to use, and the precision to reach."""

    novelty: str = "own"
    """The kind of novelty; `own` is the method's first kind."""
    target_precision: Share = 0.9
    """The precision to reach among the accepted queries."""
    unseen_share: Share = 0.2
    """The expected share of unseen queries."""

    def order(self, ranking: Ranking) -> Ranking:
        """The ranking with the wanted kind of novelty first.

        Raises ConfigError for a kind that the method does not have.
        """
        if self.novelty == "own":
            return ranking
        if self.novelty not in ranking.kinds:
            raise ConfigError(
                f"rejection.novelty={self.novelty}: expected own or one of "
                f"{', '.join(ranking.kinds)}"
            )
        return ranking.with_kind_first(self.novelty)

    def thresholds(self, model: Model, kinds: tuple[str, ...]) -> list[Threshold]:
        """Choose the threshold on each kind of novelty."""
        evidence = NoveltyEvidence.of(model)
        return [
            evidence.threshold(kind, self.unseen_share, self.target_precision) for kind in kinds
        ]

    def summary(self, model: Model, threshold: Threshold, rejected: int) -> str:
        """A line on how many queries are rejected, and the precision if it misses the target."""
        blocks = NoveltyEvidence.of(model).blocks
        target_precision = f"{self.target_precision:g}"
        if threshold.reject_from <= ACCEPT_NOTHING:
            condition = f"or is right on {LEAST_BLOCKS} of them (there are {blocks})"
            return (
                f"all rejected: no threshold keeps the wanted {target_precision} on validation "
                f"blocks, {condition}"
            )
        if threshold.validation_precision >= self.target_precision:
            return f"{rejected} rejected"
        return (
            f"{rejected} rejected; keeps {threshold.validation_precision:.3f} of the wanted "
            f"{target_precision} on {blocks} validation blocks"
        )


def reachable_threshold(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    block: NDArray[np.int64],
) -> Threshold:
    """The largest threshold that reaches the target precision, or else the highest precision.

    n queries have a `novelty`, a `weight` by which they count, and the number of their `block`. A
    query is accepted below the threshold, and is then either `right` or a false positive. One false
    positive is added, as in conformal prediction, which bounds the risk of a further query
    (Angelopoulos et al., Conformal Risk Control, ICLR 2024).

    1. For each novelty, compute the precision of accepting all queries up to it.
    2. Take the largest novelty at which the target precision is reached.
    3. If there is none, take the largest novelty with the highest precision, among the novelties
       that accept queries of LEAST_BLOCKS blocks or more. This precision is rounded down to
       thousandths.
    4. Put the threshold midway between this novelty and the next one. If there is no next one, put
       it just above, since nothing is known of queries beyond.
    """
    # 1. The precision of accepting all queries up to each novelty.
    novelties, true_positives, accepted = _accepted(novelty, right, weight)
    is_finite = np.isfinite(novelties)
    novelties = novelties[is_finite]
    # rounded, so that a precision that equals the target counts as reached
    validation_precision = (true_positives / (accepted + 1))[is_finite].round(9)

    # 2. The novelties at which the target precision is reached.
    candidates = np.flatnonzero(validation_precision >= precision)

    # 3. Otherwise the novelties with the highest precision.
    if not len(candidates):
        least_of_blocks = np.sort([novelty[block == number].min() for number in np.unique(block)])
        accepted_blocks = np.searchsorted(least_of_blocks, novelties, side="right")
        has_enough = accepted_blocks >= LEAST_BLOCKS
        best_precision = validation_precision[has_enough].max(initial=0.0)
        is_best = has_enough & (validation_precision > 0) & (validation_precision >= best_precision)
        candidates = np.flatnonzero(is_best)
        # rounded down; 1e-6, so that a whole number of thousandths stays
        validation_precision = np.floor(1000 * validation_precision + 1e-6) / 1000
    if not len(candidates):
        return Threshold(ACCEPT_NOTHING, np.nan)

    # 4. The threshold above the largest of them.
    index = candidates[-1]
    if index + 1 < len(novelties):
        reject_from = novelties[index : index + 2].mean()
    else:
        reject_from = np.nextafter(novelties[index], np.inf)
    return Threshold(float(reject_from), float(validation_precision[index]))


def threshold_for(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    wrong_besides: float = 0.0,
) -> float:
    """The largest threshold that keeps the target precision, else ACCEPT_NOTHING.

    n queries have a `novelty` and a `weight`, the number of real queries that each stands for. A
    query is accepted below the threshold, and then is either `right` or a false positive;
    `wrong_besides` false positives are added to them.
    """
    novelties, true_positives, accepted = _accepted(novelty, right, weight)
    candidates = np.flatnonzero(true_positives >= precision * (accepted + wrong_besides))
    if not len(candidates):
        return ACCEPT_NOTHING
    return float(np.nextafter(novelties[candidates[-1]], np.inf))


def _accepted(
    novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The distinct novelties in rising order, each with the weight of what is accepted up to it.

    Returns the novelties, the weights of right queries, and those of all; each (distinct,).
    """
    order = np.argsort(novelty, kind="stable")
    ordered = novelty[order]
    accepted = np.cumsum(weight[order])
    true_positives = np.cumsum((weight * right)[order])
    is_last = np.append(ordered[1:] > ordered[:-1], True)[: len(ordered)] & (accepted > 0)
    return ordered[is_last], true_positives[is_last], accepted[is_last]
