"""Thresholds on novelty from which a query is rejected as unseen.

Chosen on held-out blocks of the training sequence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Share, check
from pipeline.matching.ranking import Model, Ranking

ACCEPT_NOTHING = float(np.finfo(np.float32).min)
"""The threshold that rejects every query; a novelty is a float32."""
HELD_OUT = "held_out/"
"""Prefix of the evidence within a model."""
LEAST_BLOCKS = 10
"""Fewest held-out blocks that a threshold must accept if it keeps less than the wanted precision:
the best of many thresholds on few blocks is luck."""


class Threshold(NamedTuple):
    """A threshold on one kind of novelty, chosen on held-out blocks."""

    reject_from: float
    """ACCEPT_NOTHING where not even LEAST_BLOCKS tell of a precision."""
    kept_precision: float
    """Precision on these blocks with one false alarm added; NaN where nothing is accepted."""


@dataclass(frozen=True)
class Evidence:
    """A model's results on h held-out queries, each ranked twice.

    With the whole database, and without the places around the query: the second stands for a query
    from a place that training never saw.
    """

    right: NDArray[np.bool_]
    """(h,) whether the first answer was the true place, with the whole database."""
    seen: Mapping[str, NDArray[np.float64]]
    """Kind of novelty to its values (h,) with the whole database."""
    unseen: Mapping[str, NDArray[np.float64]]
    """The same without the places around the query."""
    block: NDArray[np.int64]
    """(h,) the held-out block of each, from 0: neighbours are no independent evidence."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its arrays, as they are stored in a model."""
        parts: dict[str, NDArray[Any]] = {
            f"{HELD_OUT}right": self.right,
            f"{HELD_OUT}block": self.block,
        }
        for name, kinds in (("seen", self.seen), ("unseen", self.unseen)):
            parts |= {
                f"{HELD_OUT}{name}/{kind}": values.astype(np.float32)
                for kind, values in kinds.items()
            }
        return parts

    @classmethod
    def of(cls, model: Model) -> Self:
        """The evidence in a model; raises InputError where it, or its blocks, are missing."""
        if HELD_OUT + "right" not in model:
            raise InputError(
                f"the model has no {HELD_OUT}right: a method must store its evidence of held-out "
                "blocks"
            )
        if HELD_OUT + "block" not in model:
            raise InputError(
                f"the model has no {HELD_OUT}block: an earlier version made it; train it anew"
            )
        seen, unseen = (
            {
                name.removeprefix(part): model[name].astype(np.float64)
                for name in model
                if name.startswith(part)
            }
            for part in (f"{HELD_OUT}seen/", f"{HELD_OUT}unseen/")
        )
        return cls(
            model[HELD_OUT + "right"].astype(bool),
            seen,
            unseen,
            model[HELD_OUT + "block"].astype(np.int64),
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The evidence of several models with the same kinds of novelty."""
        seen = {kind: np.concatenate([part.seen[kind] for part in parts]) for kind in parts[0].seen}
        unseen = {
            kind: np.concatenate([part.unseen[kind] for part in parts]) for kind in parts[0].unseen
        }
        first_blocks = np.cumsum([0, *(part.block.max(initial=-1) + 1 for part in parts)])
        block = np.concatenate(
            [part.block + offset for part, offset in zip(parts, first_blocks[:-1], strict=True)]
        )
        return cls(np.concatenate([part.right for part in parts]), seen, unseen, block)

    @property
    def blocks(self) -> int:
        """The number of blocks."""
        return len(np.unique(self.block))

    def queries(
        self, kind: str, unseen_share: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Novelty, right and weight of the 2 h queries, if `unseen_share` of queries are unseen."""
        novelty = np.concatenate([self.seen[kind], self.unseen[kind]])
        right = np.concatenate([self.right, np.zeros_like(self.right)])
        return novelty, right, np.repeat([1 - unseen_share, unseen_share], len(self.right))

    def threshold(self, kind: str, unseen_share: float, wanted_precision: float) -> Threshold:
        """Choose the threshold on one kind of novelty.

        The queries of a block share a weight of 1.
        """
        novelty, right, weight = self.queries(kind, unseen_share)
        share_of_block = 1 / np.bincount(self.block)[self.block]
        return reachable_threshold(
            wanted_precision,
            novelty,
            right,
            weight * np.tile(share_of_block, 2),
            np.tile(self.block, 2),
        )


def is_near(
    xy_m: NDArray[np.float64], others_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.bool_]:
    """Whether others (m, 2) lie nearer than `radius_m` to each query (h, 2): (h, m).

    A row where all of them do is False throughout, since a query needs something to be compared
    with.
    """
    close = np.linalg.norm(others_m - xy_m[:, None], axis=2) < radius_m
    return np.asarray(close & ~close.all(axis=1, keepdims=True))


@dataclass(frozen=True)
class Rejection:
    """Which novelty to reject by, and the precision to keep among what is accepted."""

    novelty: str = "own"
    """The method's own choice, or another of its kinds."""
    wanted_precision: Share = 0.9
    unseen_share: Share = 0.2
    """Share of unseen queries to expect."""

    def __post_init__(self) -> None:
        check(self, "rejection")

    def order(self, ranking: Ranking) -> Ranking:
        """The ranking with the wanted kind of novelty first.

        Raises ConfigError for a kind that the method has not.
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
        """The threshold on each kind of novelty."""
        evidence = Evidence.of(model)
        return [
            evidence.threshold(kind, self.unseen_share, self.wanted_precision) for kind in kinds
        ]

    def summary(self, model: Model, threshold: Threshold, rejected: int) -> str:
        """A line on how many queries are rejected, and the kept precision if less than wanted."""
        blocks = Evidence.of(model).blocks
        wanted_precision = f"{self.wanted_precision:g}"
        if threshold.reject_from <= ACCEPT_NOTHING:
            condition = f"or is right on {LEAST_BLOCKS} of them (there are {blocks})"
            return (
                f"all rejected: no threshold keeps the wanted {wanted_precision} on held-out "
                f"blocks, {condition}"
            )
        if threshold.kept_precision >= self.wanted_precision:
            return f"{rejected} rejected"
        return (
            f"{rejected} rejected; keeps {threshold.kept_precision:.3f} of the wanted "
            f"{wanted_precision} on {blocks} held-out blocks"
        )


def reachable_threshold(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    block: NDArray[np.int64],
) -> Threshold:
    """The largest threshold that keeps the wanted precision, else the one that keeps the most.

    A query (n,) of a `block` (n,) is accepted below the threshold, and then is `right` or a false
    alarm; `weight` (n,) says how much it counts. One more is counted as a false alarm. So conformal
    prediction bounds the risk of a further query (Angelopoulos et al., Conformal Risk Control, ICLR
    2024). The threshold lies midway between the last novelty that it accepts and the next one, with
    which the precision would be lost. If there is no next one it lies just above the last: nothing
    is known of queries beyond.

    Less than the wanted precision takes LEAST_BLOCKS, and is given in thousandths, rounded down.
    """
    novelties, hits, accepted = _accepted(novelty, right, weight)
    finite = np.isfinite(novelties)
    novelties = novelties[finite]
    kept_precision = (hits / (accepted + 1))[finite].round(9)
    candidates = np.flatnonzero(kept_precision >= precision)
    if not len(candidates):
        least_of_blocks = np.sort([novelty[block == number].min() for number in np.unique(block)])
        accepted_blocks = np.searchsorted(least_of_blocks, novelties, side="right")
        enough = accepted_blocks >= LEAST_BLOCKS
        best_precision = kept_precision[enough].max(initial=0.0)
        is_best = enough & (kept_precision > 0) & (kept_precision >= best_precision)
        candidates = np.flatnonzero(is_best)
        kept_precision = np.floor(1000 * kept_precision + 1e-6) / 1000
    if not len(candidates):
        return Threshold(ACCEPT_NOTHING, np.nan)
    index = candidates[-1]
    reject_from = (
        novelties[index : index + 2].mean()
        if index + 1 < len(novelties)
        else np.nextafter(novelties[index], np.inf)
    )
    return Threshold(float(reject_from), float(kept_precision[index]))


def threshold_for(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    wrong_besides: float = 0.0,
) -> float:
    """The largest threshold that keeps the wanted precision, else ACCEPT_NOTHING.

    A query (n,) is accepted below the threshold, and then is `right` or a false alarm; `weight`
    (n,) says how many real queries each stands for. As many as `wrong_besides` are counted as false
    alarms besides.
    """
    novelties, hits, accepted = _accepted(novelty, right, weight)
    candidates = np.flatnonzero(hits >= precision * (accepted + wrong_besides))
    if not len(candidates):
        return ACCEPT_NOTHING
    return float(np.nextafter(novelties[candidates[-1]], np.inf))


def _accepted(
    novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Each distinct novelty, rising, with the weights of hits and of all accepted up to it."""
    order = np.argsort(novelty, kind="stable")
    ordered = novelty[order]
    accepted = np.cumsum(weight[order])
    hits = np.cumsum((weight * right)[order])
    is_last = np.append(ordered[1:] > ordered[:-1], True)[: len(ordered)] & (accepted > 0)
    return ordered[is_last], hits[is_last], accepted[is_last]
