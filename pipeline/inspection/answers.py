"""Key numbers of the artifacts that say where a query is: labels, rankings, evaluations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.highlights import Highlights
from pipeline.inspection.inspection import Section, metres
from pipeline.store import Artifact


def labels(artifact: Artifact) -> Highlights:
    """How much of the sequence training has seen."""
    places, oracle, nearest = (artifact.load(name) for name in ("places", "oracle", "nearest_m"))
    seen = places >= 0
    rows = [
        ("submaps", f"{len(places):,}"),
        ("places", f"{artifact['cells'].shape[0]:,} of training, {_distinct(places[seen]):,} met here"),
    ]
    warnings = []
    if len(places):
        rows.append(("seen", f"{int(seen.sum()):,} submaps ({100 * seen.mean():.1f} %), unseen {int((~seen).sum()):,}"))
        rows.append(
            ("nearest", f"training anchor: median {metres(float(np.median(nearest)))}, farthest {metres(float(nearest.max()))}")
        )
    if seen.any():
        rows.append(
            (
                "oracle",
                f"{100 * (oracle == places)[seen].mean():.1f} % of the seen have their nearest training anchor in their place",
            )
        )
    elif len(places):
        warnings.append("no submap lies in a place of training: do both sequences share one world frame, and the grid's box?")
    return Highlights((Section("", tuple(rows)),), tuple(warnings))


def rankings(artifact: Artifact) -> Highlights:
    """What the method answered, without the truth."""
    places, costs, novelty = (artifact.load(name) for name in ("places", "costs", "novelty"))
    threshold = float(artifact.attrs["threshold"])
    rows = [("queries", f"{len(places):,}, {places.shape[1]} places each")]
    warnings = []
    if len(places):
        low, mid, high = np.percentile(novelty, (5, 50, 95))
        told = np.isfinite(artifact.load("heading_deg")).mean()
        rows += [
            ("novelty", f"5 % {low:.3g}, median {mid:.3g}, 95 % {high:.3g}"),
            ("rejected", f"{100 * (novelty >= threshold).mean():.1f} % at the threshold {threshold:.4g}"),
            ("first answers", f"{_distinct(places[:, 0]):,} distinct places"),
            ("heading", f"told for {100 * told:.3g} % of the queries"),
        ]
        if (np.diff(costs, axis=1) < 0).any():
            warnings.append("costs do not rise along the ranks: the method ranked wrongly, and its recall means nothing")
        if len(places) > 1 and _distinct(places[:, 0]) == 1:
            warnings.append("every query gets the same first answer: the model learned nothing, or the views are blank")
    return Highlights((Section("", tuple(rows)),), tuple(warnings))


def evaluations(artifact: Artifact) -> Highlights:
    """How it fared."""
    auc, seen, rank, outcome = (artifact.load(name) for name in ("auc", "seen", "true_rank", "outcome"))
    error = artifact.load("error_m")
    rows = [("queries", f"{len(seen):,}, {int(seen.sum()):,} seen and {int((~seen).sum()):,} unseen")]
    tops = [n for n in (1, 5, 25) if n <= len(auc)]
    rows.append(("AUC", ", ".join(f"top {n} {auc[n - 1]:.3f}" for n in tops)))
    if seen.any():
        rows.append(
            (
                "recall",
                ", ".join(f"top {n} {((rank >= 0) & (rank < n))[seen].mean():.3f}" for n in tops) + " of the seen, none rejected",
            )
        )
        rows.append(("error", f"median {metres(float(np.nanmedian(error[seen])))} of the seen queries' first answers"))
    names = ("hits", "misses", "false alarms", "correct rejections")
    counts = ", ".join(f"{int((outcome == code).sum()):,} {name}" for code, name in enumerate(names))
    rows.append(("outcome", f"{counts} at the threshold {float(artifact.attrs['threshold']):.4g}"))
    rows.append(
        ("trained", f"on {artifact.attrs['train']}, tested on {artifact.attrs['sequence']}, {artifact.attrs['days']} days later")
    )
    warnings = () if seen.any() or not len(seen) else ("no query was seen in training: recall and AUC mean nothing here",)
    return Highlights((Section("", tuple(rows)),), warnings)


def _distinct(values: NDArray[Any]) -> int:
    return len(np.unique(values))
