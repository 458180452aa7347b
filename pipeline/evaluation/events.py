"""Results by the distance to a change: evaluations and changes in; numbers per band out.

A change is a thing that was built or torn down since training. These are real changes of the world,
unlike those that an alteration draws into single queries: they hide, widen and open up views for
good. Queries are grouped in bands of distance to the nearest one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import check
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.counts import is_right_at
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import Weight, auc_exact, share
from pipeline.formats.changes import Change

NUMBERS = ("recall_at_1", "oracle", "auc_exact_top1")
APART_M = 1e6
"""How far apart the paths of pooled sequences are laid, so that no bootstrap block holds queries of
two."""


@dataclass(frozen=True)
class Bands:
    """How queries are grouped by distance: keys of conf/results.yaml."""

    edges_m: Sequence[float] = (25.0, 50.0, 100.0)
    """Where bands end, rising; the last band has no end."""
    kinds: Sequence[str] = ("construction", "demolition")
    """Which changes count. Trees are left out: they change everywhere."""

    def __post_init__(self) -> None:
        check(self, "bands")
        if not self.edges_m or list(self.edges_m) != sorted(
            {float(edge) for edge in self.edges_m if edge > 0}
        ):
            raise ConfigError(
                f"bands.edges_m={list(self.edges_m)}: expected rising distances above 0"
            )

    @property
    def names(self) -> list[str]:
        """By default `0–25 m`, `25–50 m`, `50–100 m`, `over 100 m`."""
        edges = [f"{edge:g}" for edge in (0.0, *self.edges_m)]
        return [f"{low}–{high} m" for low, high in pairwise(edges)] + [f"over {edges[-1]} m"]

    def band_of(self, away_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The band (q,) of each distance (q,).

        A distance on an edge belongs to the nearer band; NaN gives −1.
        """
        return np.where(
            np.isnan(away_m),
            -1,
            np.searchsorted(np.asarray(self.edges_m, np.float64), away_m, side="left"),
        )


@dataclass(frozen=True)
class BandResults:
    """One method's results by one protocol in each band of distance, over all its sequences."""

    seen: NDArray[np.int64]
    """(band,) seen queries."""
    unseen: NDArray[np.int64]
    """(band,) unseen queries."""
    values: NDArray[np.float64]
    """(band, number, 3): NUMBERS, each with its lowest and highest; NaN where there is none."""


def nearest_m(xy_m: NDArray[np.float64], changes: Iterable[Change]) -> NDArray[np.float64]:
    """Distance (q,) from positions (q, 2) to the nearest change; infinite where there is none."""
    positions = [(change.x_m, change.y_m) for change in changes]
    changes_xy_m = np.array(positions, np.float64).reshape(-1, 2)
    distances_m = np.linalg.norm(changes_xy_m - xy_m[:, None], axis=2)
    return np.asarray(distances_m.min(axis=1, initial=np.inf))


def distances(
    xy_m: Mapping[str, NDArray[np.float64]],
    changes: Mapping[str, Iterable[Change]],
    kinds: Sequence[str],
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Distances (q,) of queries (q, 2) to the nearest shown change and to one to come, by sequence.

    `changes` of each sequence are those that show on its day. A change to come shows in other
    sequences only. It is a control: the same streets, before they change. Its distance is NaN where
    a shown change is nearer.
    """
    shown_on_day = {
        sequence: {change for change in changes[sequence] if change.what in kinds}
        for sequence in xy_m
    }
    all_changes = set().union(*shown_on_day.values())
    distances_m = {}
    for sequence, positions_m in xy_m.items():
        shown_m = nearest_m(positions_m, shown_on_day[sequence])
        to_come_m = nearest_m(positions_m, all_changes - shown_on_day[sequence])
        distances_m[sequence] = shown_m, np.where(to_come_m < shown_m, to_come_m, np.nan)
    return distances_m


def judge_by_band(
    evaluations: Sequence[Evaluation],
    away_m: Sequence[NDArray[np.float64]],
    bands: Bands,
    protocol: str,
    bootstrap: Bootstrap,
) -> BandResults:
    """Judge one method's queries of all sequences together, in each band of distance to a change.

    Each query counts once; `away_m` (q,) of each evaluation is its distance, NaN to leave it out.
    The threshold of the exact curve passes the novelties of all sequences together.
    """
    band = bands.band_of(np.concatenate(away_m))
    novelty = np.concatenate([evaluation.novelty[:, 0] for evaluation in evaluations])
    truths = [evaluation.truth(protocol) for evaluation in evaluations]
    fields = ("seen", "unseen", "true_rank", "oracle_right")
    pooled: dict[str, Any] = {
        name: np.concatenate([getattr(truth, name) for truth in truths]) for name in fields
    }
    queries_of_band = [np.flatnonzero(band == i) for i in range(len(bands.names))]
    # All truths go by one protocol, so the first one's `recall_of_all_seen` holds for all.
    parts = [
        replace(truths[0], **{name: array[queries] for name, array in pooled.items()})
        for queries in queries_of_band
    ]

    def numbers(weight: Weight) -> NDArray[np.float64]:
        values = []  # in the order of NUMBERS
        for queries, part in zip(queries_of_band, parts, strict=True):
            band_weight = weight[:, queries]
            values.append(share(is_right_at(part, 1), part.seen, band_weight))
            values.append(share(part.oracle_right, part.seen, band_weight))
            values.append(auc_exact(part, novelty[queries], band_weight))
        return np.stack(values)

    separated_xy_m = np.concatenate(
        [evaluation.xy_m + np.array([APART_M * i, 0.0]) for i, evaluation in enumerate(evaluations)]
    )
    estimates = bootstrap.estimates(numbers, separated_xy_m)
    return BandResults(
        seen=np.array([part.seen.sum() for part in parts]),
        unseen=np.array([part.unseen.sum() for part in parts]),
        values=estimates.reshape(len(parts), len(NUMBERS), 3),
    )
