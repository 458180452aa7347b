"""Thresholds on novelty, above which a query is rejected as unseen; chosen on held-out blocks of
the training sequence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.matching.ranking import Model, Ranking
from pipeline.running.settings import Share, check

ACCEPT_NOTHING = float(
    np.finfo(np.float32).min
)  # the threshold that rejects every query; a novelty is a float32
PREFIX = "held_out/"
LEAST_BLOCKS = 10
"""Blocks to accept before less than the wanted precision is offered: the best of many thresholds on
few blocks is luck."""


@dataclass(frozen=True)
class Evidence:
    """A model's results on h held-out queries, each ranked twice: with the whole database, and
    without the places around it.

    The second stands for a query from a place that training never saw.
    """

    right: NDArray[
        np.bool_
    ]  # (h,) whether the first answer was the true place, with the whole database
    seen: Mapping[
        str, NDArray[np.float64]
    ]  # kind of novelty to its values (h,) with the whole database
    unseen: Mapping[str, NDArray[np.float64]]  # the same without the places around the query
    block: NDArray[
        np.int64
    ]  # (h,) the held-out block of each, from 0: neighbours are no independent evidence

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its arrays, as they are stored in a model."""
        parts: dict[str, NDArray[Any]] = {
            f"{PREFIX}right": self.right,
            f"{PREFIX}block": self.block,
        }
        for name, kinds in (("seen", self.seen), ("unseen", self.unseen)):
            parts |= {
                f"{PREFIX}{name}/{kind}": values.astype(np.float32)
                for kind, values in kinds.items()
            }
        return parts

    @classmethod
    def of(cls, model: Model) -> Self:
        """The evidence in a model; raises InputError where it has none, or none that says its
        blocks."""
        if PREFIX + "right" not in model:
            raise InputError(
                f"the model has no {PREFIX}right: a method must store its evidence of held-out "
                "blocks"
            )
        if PREFIX + "block" not in model:
            raise InputError(
                f"the model has no {PREFIX}block: an earlier version made it; train it anew"
            )
        seen, unseen = (
            {
                name.removeprefix(part): model[name].astype(np.float64)
                for name in model
                if name.startswith(part)
            }
            for part in (f"{PREFIX}seen/", f"{PREFIX}unseen/")
        )
        return cls(
            model[PREFIX + "right"].astype(bool),
            seen,
            unseen,
            model[PREFIX + "block"].astype(np.int64),
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Of several models' held-out queries, of the same kinds of novelty."""
        seen = {kind: np.concatenate([one.seen[kind] for one in parts]) for kind in parts[0].seen}
        unseen = {
            kind: np.concatenate([one.unseen[kind] for one in parts]) for kind in parts[0].unseen
        }
        before = np.cumsum([0, *(one.block.max(initial=-1) + 1 for one in parts)])
        block = np.concatenate(
            [one.block + first for one, first in zip(parts, before[:-1], strict=True)]
        )
        return cls(np.concatenate([one.right for one in parts]), seen, unseen, block)

    @property
    def blocks(self) -> int:
        """How many there are."""
        return len(np.unique(self.block))

    def queries(
        self, kind: str, unseen_share: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Novelty, right and weight of the 2 h queries, when a share of all queries is to be
        expected unseen."""
        novelty = np.concatenate([self.seen[kind], self.unseen[kind]])
        right = np.concatenate([self.right, np.zeros_like(self.right)])
        return novelty, right, np.repeat([1 - unseen_share, unseen_share], len(self.right))

    def threshold(self, kind: str, unseen_share: float, wanted_precision: float) -> "Threshold":
        """On one kind of novelty, the queries of a block sharing a weight of 1."""
        novelty, right, weight = self.queries(kind, unseen_share)
        of_block = 1 / np.bincount(self.block)[self.block]
        return reachable(
            wanted_precision, novelty, right, weight * np.tile(of_block, 2), np.tile(self.block, 2)
        )


def near(
    xy_m: NDArray[np.float64], others_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.bool_]:
    """Whether others (m, 2) lie nearer than `radius_m` to each query (h, 2): (h, m).

    A row where all of them do is False throughout, since a query needs something to be compared
    with.
    """
    close = np.linalg.norm(others_m - xy_m[:, None], axis=2) < radius_m
    return np.asarray(close & ~close.all(axis=1, keepdims=True))


class Threshold(NamedTuple):
    """Of one kind of novelty, chosen on held-out blocks."""

    reject_from: float  # ACCEPT_NOTHING where not even LEAST_BLOCKS tell of a precision
    kept_precision: (
        float  # on these blocks, one more accepted counted wrong; NaN where nothing is accepted
    )


@dataclass(frozen=True)
class Rejection:
    """Which novelty to reject by, and the precision to keep among what is accepted."""

    novelty: str = "own"  # the method's own choice, or another of its kinds
    wanted_precision: Share = 0.9
    unseen_share: Share = 0.2  # share of unseen queries to expect

    def __post_init__(self) -> None:
        check(self, "rejection")

    def order(self, ranking: Ranking) -> Ranking:
        """The ranking with the wanted kind of novelty first; raises ConfigError for one that the
        method has not."""
        if self.novelty == "own":
            return ranking
        if self.novelty not in ranking.kinds:
            raise ConfigError(
                f"rejection.novelty={self.novelty}: expected own or one of "
                f"{', '.join(ranking.kinds)}"
            )
        return ranking.by(self.novelty)

    def thresholds(self, model: Model, kinds: tuple[str, ...]) -> list[Threshold]:
        """Of each kind."""
        evidence = Evidence.of(model)
        return [
            evidence.threshold(kind, self.unseen_share, self.wanted_precision) for kind in kinds
        ]

    def summary(self, model: Model, threshold: Threshold, rejected: int) -> str:
        """How many queries are rejected at that threshold of a model, and what it keeps where that
        is less than wanted."""
        blocks = Evidence.of(model).blocks
        wanted = f"{self.wanted_precision:g}"
        if threshold.reject_from <= ACCEPT_NOTHING:
            few = f"or is right on {LEAST_BLOCKS} of them (there are {blocks})"
            return f"all rejected: no threshold keeps the wanted {wanted} on held-out blocks, {few}"
        less = (
            f"; keeps {threshold.kept_precision:.3f} of the wanted {wanted} on {blocks} held-out "
            "blocks"
        )
        return f"{rejected} rejected{less * (threshold.kept_precision < self.wanted_precision)}"


def reachable(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    block: NDArray[np.int64],
) -> Threshold:
    """The largest threshold that keeps the wanted precision; where none does, the one that keeps
    the most.

    A query (n,) of a `block` (n,) is accepted below the threshold, and then is `right` or a false
    alarm; `weight` (n,) says how much it counts. One more is counted as a false alarm. So conformal
    prediction bounds the risk of a further query (Angelopoulos et al., Conformal Risk Control, ICLR
    2024). The threshold lies midway from the last accepted novelty to the next, which would break
    the precision; without a next, it lies just above the last, since of newer queries nothing is
    known.

    Less than the wanted precision takes LEAST_BLOCKS, and is told in thousandths, rounded down.
    """
    novelties, hits, accepted = _accepted(novelty, right, weight)
    finite = np.isfinite(novelties)
    novelties = novelties[finite]
    kept = (hits / (accepted + 1))[finite].round(9)
    good = np.flatnonzero(kept >= precision)
    if not len(good):
        begins = np.sort([novelty[block == one].min() for one in np.unique(block)])
        enough = np.searchsorted(begins, novelties, side="right") >= LEAST_BLOCKS
        good = np.flatnonzero(enough & (kept > 0) & (kept >= kept[enough].max(initial=0.0)))
        kept = np.floor(1000 * kept + 1e-6) / 1000
    if not len(good):
        return Threshold(ACCEPT_NOTHING, np.nan)
    last = good[-1]
    ends = (
        novelties[last : last + 2].mean()
        if last + 1 < len(novelties)
        else np.nextafter(novelties[last], np.inf)
    )
    return Threshold(float(ends), float(kept[last]))


def threshold_for(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    wrong_besides: float = 0.0,
) -> float:
    """The largest threshold that keeps the wanted precision among what it accepts; ACCEPT_NOTHING
    where none does.

    A query (n,) is accepted below the threshold, and then is `right` or a false alarm; `weight`
    (n,) says how many real queries each stands for. As many as `wrong_besides` are counted as false
    alarms besides.
    """
    novelties, hits, accepted = _accepted(novelty, right, weight)
    good = np.flatnonzero(hits >= precision * (accepted + wrong_besides))
    return float(np.nextafter(novelties[good[-1]], np.inf)) if len(good) else ACCEPT_NOTHING


def _accepted(
    novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Each distinct novelty in rising order, and the weights of the hits and of all that are
    accepted up to it."""
    order = np.argsort(novelty, kind="stable")
    ordered = novelty[order]
    accepted = np.cumsum(weight[order])
    hits = np.cumsum((weight * right)[order])
    last = np.append(ordered[1:] > ordered[:-1], True)[: len(ordered)] & (accepted > 0)
    return ordered[last], hits[last], accepted[last]
