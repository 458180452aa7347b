"""Results by the distance to a change: how much do new and demolished buildings harm a method?

In: a method's evaluations on all test sequences, and the changes of the world: what was built or
torn down since training. Out: recall and area under the curve for the queries in each band of
distance to the nearest change. These changes belong to the (simulated) world itself and stay. A
perturbation, in contrast, changes the points of single queries.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import checked
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.counts import is_right_at
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.numbers import Weight, auc_exact, share
from pipeline.formats.changes import Change

NUMBERS = ("recall_at_1", "oracle", "auc_exact_top1")
"""The numbers of each band (evaluation.numbers.MEANINGS says what each is)."""
APART_M = 1e6
"""Distance by which the paths of pooled sequences are set apart, so that no block of the bootstrap
holds queries of two sequences."""


@dataclass(frozen=True)
@checked("bands")
class Bands:
    """How queries are grouped by distance: keys of conf/results.yaml."""

    edges_m: Sequence[float] = (25.0, 50.0, 100.0)
    """Where bands end, rising; the last band has no end."""
    kinds: Sequence[str] = ("construction", "demolition")
    """The kinds of changes that count. Trees are left out, since they change everywhere."""

    def __post_init__(self) -> None:
        rising_edges_m = sorted({float(edge) for edge in self.edges_m if edge > 0})
        if not self.edges_m or list(self.edges_m) != rising_edges_m:
            raise ConfigError(
                f"bands.edges_m={list(self.edges_m)}: expected rising distances above 0"
            )

    @property
    def names(self) -> list[str]:
        """The names of the bands, by default `0–25 m`, `25–50 m`, `50–100 m`, `over 100 m`."""
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
    """(band,) number of seen queries."""
    unseen: NDArray[np.int64]
    """(band,) number of unseen queries."""
    values: NDArray[np.float64]
    """(band, number, 3) each of NUMBERS: value, and lowest and highest of its 95 % interval; NaN
    where it is undefined."""


class ChangeDistances(NamedTuple):
    """Distances of the queries of one sequence to the nearest change."""

    shown_m: NDArray[np.float64]
    """(q,) distance to the nearest change that shows on the day of the sequence."""
    to_come_m: NDArray[np.float64]
    """(q,) distance to the nearest change that does not show on this day, but on another test day;
    NaN if there is none, or if a change that shows on this day is at least as near."""


def nearest_m(xy_m: NDArray[np.float64], changes: Iterable[Change]) -> NDArray[np.float64]:
    """Distance (q,) from positions (q, 2) to the nearest change; infinite without changes."""
    positions = [(change.x_m, change.y_m) for change in changes]
    changes_xy_m = np.array(positions, np.float64).reshape(-1, 2)
    distances_m = np.linalg.norm(changes_xy_m - xy_m[:, None], axis=2)
    return np.asarray(distances_m.min(axis=1, initial=np.inf))


def distances(
    xy_m: Mapping[str, NDArray[np.float64]],
    changes: Mapping[str, Iterable[Change]],
    kinds: Sequence[str],
) -> dict[str, ChangeDistances]:
    """Distances of queries at positions (q, 2) to the nearest change of these kinds, by sequence.

    `changes` of a sequence are those that show on its day. A change that shows in other sequences
    only is still to come, since changes stay. Queries near it are a control: streets that will
    change, before they do.
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
        to_come_m = np.where(to_come_m < shown_m, to_come_m, np.nan)
        distances_m[sequence] = ChangeDistances(shown_m, to_come_m)
    return distances_m


def judge_by_band(
    evaluations: Sequence[Evaluation],
    away_m: Sequence[NDArray[np.float64]],
    bands: Bands,
    protocol: str,
    bootstrap: Bootstrap,
) -> BandResults:
    """Judge one method's queries of all sequences together, in each band of distance to a change.

    `away_m` (q,) of each evaluation are its queries' distances, either of `ChangeDistances`; NaN
    for a query to leave out. The exact curve of a band has the novelties of all its queries as
    thresholds, whatever the sequence.
    """
    band = bands.band_of(np.concatenate(away_m))
    novelty = np.concatenate([evaluation.novelty[:, 0] for evaluation in evaluations])
    ground_truths = [evaluation.ground_truth(protocol) for evaluation in evaluations]
    fields = ("seen", "unseen", "true_rank", "oracle_right")
    pooled: dict[str, Any] = {
        name: np.concatenate([getattr(ground_truth, name) for ground_truth in ground_truths])
        for name in fields
    }
    queries_of_band = [np.flatnonzero(band == i) for i in range(len(bands.names))]
    ground_truth_of_band = []
    for queries in queries_of_band:
        of_band = {name: array[queries] for name, array in pooled.items()}
        # All are of one protocol, so the `recall_of_all_seen` of the first holds for all.
        ground_truth_of_band.append(replace(ground_truths[0], **of_band))

    def numbers(weight: Weight) -> NDArray[np.float64]:
        """Each of NUMBERS, band after band (band · number, resample).

        `weight` (resample, query) says how often each resample holds each query.
        """
        values = []
        for queries, ground_truth in zip(queries_of_band, ground_truth_of_band, strict=True):
            band_weight = weight[:, queries]
            values.append(share(is_right_at(ground_truth, 1), ground_truth.seen, band_weight))
            values.append(share(ground_truth.oracle_right, ground_truth.seen, band_weight))
            values.append(auc_exact(ground_truth, novelty[queries], band_weight))
        return np.stack(values)

    separated_xy_m = np.concatenate(
        [evaluation.xy_m + np.array([APART_M * i, 0.0]) for i, evaluation in enumerate(evaluations)]
    )
    estimates = bootstrap.estimates(numbers, separated_xy_m)
    return BandResults(
        seen=np.array([ground_truth.seen.sum() for ground_truth in ground_truth_of_band]),
        unseen=np.array([ground_truth.unseen.sum() for ground_truth in ground_truth_of_band]),
        values=estimates.reshape(len(ground_truth_of_band), len(NUMBERS), 3),
    )
