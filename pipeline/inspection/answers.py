"""Describes, for `yearloc inspect`, artifacts with a row a query: labels, rankings, evaluations.

Each function adds the key numbers of one artifact as rows of text, and warnings, to an Inspection.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Labels, Rankings
from pipeline.evaluation.evaluations import Evaluation, Evaluations
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.inspection import Inspection, metres

OUTCOMES = ("hits", "misses", "false alarms", "correct rejections", "not judged")
"""What the numbers 0 to 4 in the array `outcome` of an evaluation mean."""
RANKS = (1, 5, 25)
"""How many answers a query may have for the recall and the AUC that are shown."""


def add_labels(artifact: Labels, inspection: Inspection) -> None:
    """Add how many submaps of the sequence lie in places that training visited."""
    places = artifact.places
    nearest_m = artifact.nearest_m
    is_seen = places >= 0
    rows = [
        ("submaps", f"{len(places):,}"),
        (
            "places",
            f"{len(artifact.cells):,} of training, {_distinct_count(places[is_seen]):,} met here",
        ),
    ]
    if len(places):
        rows += [
            (
                "seen",
                f"{int(is_seen.sum()):,} submaps ({100 * is_seen.mean():.1f} %), unseen "
                f"{int((~is_seen).sum()):,}",
            ),
            (
                "nearest",
                f"training anchor: median {metres(np.median(nearest_m))}, farthest "
                f"{metres(nearest_m.max())}",
            ),
        ]
    if is_seen.any():
        # the oracle answers with the place of the nearest training anchor
        share = f"{100 * (artifact.oracle == places)[is_seen].mean():.1f} %"
        rows.append(
            ("oracle", f"{share} of the seen have their nearest training anchor in their place")
        )
    inspection.add("", *rows)
    no_overlap = (
        "no submap lies in a place of training: do both sequences share one world frame, and the "
        "grid's box?"
    )
    inspection.warn_if(len(places) and not is_seen.any(), no_overlap)


def add_rankings(artifact: Rankings, inspection: Inspection) -> None:
    """Add numbers on the answers of the method, without comparing them with the ground truth."""
    places = artifact.places
    confidence = artifact.confidence
    queries = ("queries", f"{len(places):,}, {places.shape[1]} places each")
    if not len(places):
        inspection.add("", queries)
        return
    answer_count = _distinct_count(places[:, 0])
    heading_share = np.isfinite(artifact.heading_deg[:, 0]).mean()
    inspection.add(
        "",
        queries,
        ("first answers", f"{answer_count:,} distinct places"),
        ("heading", f"estimated for {100 * heading_share:.3g} % of the queries"),
        ("confidence", "none" if np.isnan(confidence).any() else _quantiles(confidence)),
    )
    inspection.add("novelty, the first kind in use", *_novelty_rows(artifact))
    costs_fall = (np.diff(artifact.costs, axis=1) < 0).any()
    inspection.warn_if(
        costs_fall,
        "costs do not rise along the ranks: the method ranked wrongly, and its recall means "
        "nothing",
    )
    constant_answer = (
        "every query gets the same first answer: the model learned nothing, or the views are blank"
    )
    inspection.warn_if(len(places) > 1 and answer_count == 1, constant_answer)


def _novelty_rows(artifact: Rankings) -> list[tuple[str, str]]:
    """A row for each kind of novelty: its distribution, and how many queries it rejects."""
    target_precision = artifact.target_precision
    rows = []
    for kind, threshold, values, precision in zip(
        artifact.kinds,
        artifact.thresholds,
        artifact.novelty.T,
        artifact.validation_precision,
        strict=True,
    ):
        rejected_share = f"{100 * (values >= threshold).mean():.1f} %"
        text = f"{_quantiles(values)}; rejects {rejected_share} from {threshold:.4g} on"
        if precision < target_precision:
            text += (
                f"; reaches {precision:.3f} of the target {target_precision:g} on validation blocks"
            )
        rows.append((kind, text))
    return rows


def add_evaluations(artifact: Evaluations, inspection: Inspection) -> None:
    """Add the results of the unperturbed queries, by both protocols: by cells and by distance."""
    evaluation = artifact.case()
    inspection.add(
        "",
        ("queries", f"{len(evaluation.answer):,}"),
        (
            "trained",
            f"on {artifact.train}, tested on {artifact.sequence}, {evaluation.days} days later",
        ),
        ("threshold", f"{evaluation.reject_from[0]:.4g} on {evaluation.kinds[0]}"),
    )
    for name in PROTOCOLS:
        inspection.add(f"by {name}", *_protocol_rows(evaluation, name))
    unseen_protocols = [
        name
        for name in PROTOCOLS
        if len(evaluation.answer) and not evaluation.protocol(name).seen.any()
    ]
    inspection.warn_if(
        bool(unseen_protocols),
        f"no query was seen in training by {' or '.join(unseen_protocols)}: recall and AUC mean "
        "nothing there",
    )


def _protocol_rows(evaluation: Evaluation, protocol: str) -> list[tuple[str, str]]:
    """The results by one protocol."""
    judgement = evaluation.protocol(protocol)

    def text(name: str) -> str:
        """A number with its interval."""
        value, low, high = evaluation.number(protocol, name)
        interval = f" ({low:.3f}–{high:.3f})" if low <= high else ""
        return f"{value:.3f}{interval}" if np.isfinite(value) else "none"

    recalls = ", ".join(f"at {rank} {text(f'recall_at_{rank}')}" for rank in RANKS)
    aucs = ", ".join(f"top {rank} {text(f'auc_top{rank}')}" for rank in RANKS)
    rejection_recall = text("recall_at_99_precision")
    counts = np.bincount(judgement.outcome, minlength=len(OUTCOMES))
    outcomes = ", ".join(f"{count:,} {name}" for count, name in zip(counts, OUTCOMES, strict=True))
    rows = [
        (
            "queries",
            f"{int(judgement.seen.sum()):,} seen and {int(judgement.unseen.sum()):,} unseen",
        ),
        ("recall", f"{recalls} of the seen, none rejected"),
        ("oracle", f"{text('oracle')}: the nearest training anchor's answer"),
        ("AUC", f"{aucs}, exact {text('auc_exact_top1')}"),
    ]
    if np.isfinite(evaluation.number(protocol, "heading_within_10deg").value):
        median = text("median_heading_error_deg")
        share = text("heading_within_10deg")
        rows.append(("heading", f"median error {median}°, within 10° {share} of the right"))
    rows += [
        ("rejection", f"AUROC {text('auroc')}, recall at 99 % precision {rejection_recall}"),
        ("outcome", f"{outcomes} at the threshold"),
    ]
    return rows


def _quantiles(values: NDArray[Any]) -> str:
    return "5 % {:.3g}, median {:.3g}, 95 % {:.3g}".format(*np.percentile(values, (5, 50, 95)))


def _distinct_count(values: NDArray[Any]) -> int:
    return len(np.unique(values))
