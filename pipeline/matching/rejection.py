"""Thresholds on novelty, above which a query is rejected as unseen; chosen on held-out blocks of the training sequence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.matching.ranking import Model, Ranking
from pipeline.running.settings import Share, check

ACCEPT_NOTHING = float(np.finfo(np.float32).min)  # the threshold that rejects every query; a novelty is a float32
PREFIX = "held_out/"


@dataclass(frozen=True)
class Evidence:
    """A model's results on h held-out queries, each ranked twice: with the whole database, and without the places around it.

    The second stands for a query from a place that training never saw.
    """

    right: NDArray[np.bool_]  # (h,) whether the first answer was the true place, with the whole database
    seen: Mapping[str, NDArray[np.float64]]  # kind of novelty to its values (h,) with the whole database
    unseen: Mapping[str, NDArray[np.float64]]  # the same without the places around the query

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its arrays, as they are stored in a model."""
        parts: dict[str, NDArray[Any]] = {f"{PREFIX}right": self.right}
        for name, kinds in (("seen", self.seen), ("unseen", self.unseen)):
            parts |= {f"{PREFIX}{name}/{kind}": values.astype(np.float32) for kind, values in kinds.items()}
        return parts

    @classmethod
    def of(cls, model: Model) -> Self:
        """The evidence in a model; raises InputError where it has none."""
        if PREFIX + "right" not in model:
            raise InputError(f"the model has no {PREFIX}right: a method must store its evidence of held-out blocks")
        seen, unseen = (
            {name.removeprefix(part): model[name].astype(np.float64) for name in model if name.startswith(part)}
            for part in (f"{PREFIX}seen/", f"{PREFIX}unseen/")
        )
        return cls(model[PREFIX + "right"].astype(bool), seen, unseen)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Of several models' held-out queries, of the same kinds of novelty."""
        seen = {kind: np.concatenate([one.seen[kind] for one in parts]) for kind in parts[0].seen}
        unseen = {kind: np.concatenate([one.unseen[kind] for one in parts]) for kind in parts[0].unseen}
        return cls(np.concatenate([one.right for one in parts]), seen, unseen)

    def queries(self, kind: str, unseen_share: float) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Novelty, right and weight of the 2 h queries, when a share of all queries is to be expected unseen."""
        novelty = np.concatenate([self.seen[kind], self.unseen[kind]])
        right = np.concatenate([self.right, np.zeros_like(self.right)])
        return novelty, right, np.repeat([1 - unseen_share, unseen_share], len(self.right))


def near(xy_m: NDArray[np.float64], others_m: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
    """Whether others (m, 2) lie nearer than `radius_m` to each query (h, 2): (h, m).

    A row where all of them do is False throughout, since a query needs something to be compared with.
    """
    close = np.linalg.norm(others_m - xy_m[:, None], axis=2) < radius_m
    return np.asarray(close & ~close.all(axis=1, keepdims=True))


@dataclass(frozen=True)
class Rejection:
    """Which novelty to reject by, and the precision to keep among what is accepted."""

    novelty: str = "own"  # the method's own choice, or another of its kinds
    wanted_precision: Share = 0.9
    unseen_share: Share = 0.2  # share of unseen queries to expect

    def __post_init__(self) -> None:
        check(self, "rejection")

    def order(self, ranking: Ranking) -> Ranking:
        """The ranking with the wanted kind of novelty first; raises ConfigError for one that the method has not."""
        if self.novelty == "own":
            return ranking
        if self.novelty not in ranking.kinds:
            raise ConfigError(f"rejection.novelty={self.novelty}: expected own or one of {', '.join(ranking.kinds)}")
        return ranking.by(self.novelty)

    def thresholds(self, model: Model, kinds: tuple[str, ...]) -> list[float]:
        """The novelty to reject from, for each kind."""
        evidence = Evidence.of(model)
        return [threshold_for(self.wanted_precision, *evidence.queries(kind, self.unseen_share)) for kind in kinds]

    def summary(self, model: Model, kind: str, rejected: int) -> str:
        """How many queries are rejected; where all must be, which precision can be kept instead."""
        evidence = Evidence.of(model)
        best = best_precision(*evidence.queries(kind, self.unseen_share))
        if best >= self.wanted_precision:
            return f"{rejected} rejected"
        held_out = f"no threshold keeps {self.wanted_precision:g} on {len(evidence.right)} held-out queries"
        return f"all rejected: {held_out}; the best keeps {best:.3f}: rejection.wanted_precision={np.floor(100 * best) / 100:g}"


def threshold_for(
    precision: float,
    novelty: NDArray[np.float64],
    right: NDArray[np.bool_],
    weight: NDArray[np.float64],
    wrong_besides: float = 0.0,
) -> float:
    """The largest threshold that keeps the wanted precision among what it accepts; ACCEPT_NOTHING where none does.

    A query (n,) is accepted below the threshold, and then is `right` or a false alarm; `weight` (n,) says how many real
    queries each stands for. As many as `wrong_besides` are counted as false alarms besides.
    """
    novelties, hits, accepted = _accepted(novelty, right, weight)
    good = np.flatnonzero(hits >= precision * (accepted + wrong_besides))
    return float(np.nextafter(novelties[good[-1]], np.inf)) if len(good) else ACCEPT_NOTHING


def best_precision(novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]) -> float:
    """The highest precision that any threshold keeps among what it accepts; 0 of no query."""
    _, hits, accepted = _accepted(novelty, right, weight)
    return float((hits / accepted).max(initial=0.0))


def _accepted(
    novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Each distinct novelty in rising order, and the weights of the hits and of all that are accepted up to it."""
    order = np.argsort(novelty, kind="stable")
    ordered, accepted, hits = novelty[order], np.cumsum(weight[order]), np.cumsum((weight * right)[order])
    last = np.append(ordered[1:] > ordered[:-1], True)[: len(ordered)] & (accepted > 0)
    return ordered[last], hits[last], accepted[last]
