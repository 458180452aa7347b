"""Key numbers of the artifacts that say where a query is: labels, rankings, evaluations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.judgement import Evaluation, Judgement, summary
from pipeline.evaluation.numbers import NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.highlights import Highlights
from pipeline.inspection.inspection import Section, metres
from pipeline.store import Artifact

OUTCOMES = ("hits", "misses", "false alarms", "correct rejections", "not judged")


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
    places, costs, novelty, confidence = (artifact.load(name) for name in ("places", "costs", "novelty", "confidence"))
    rows = [("queries", f"{len(places):,}, {places.shape[1]} places each")]
    if not len(places):
        return Highlights((Section("", tuple(rows)),))
    told = np.isfinite(artifact.load("heading_deg")).mean()
    rows += [
        ("first answers", f"{_distinct(places[:, 0]):,} distinct places"),
        ("heading", f"told for {100 * told:.3g} % of the queries"),
        ("confidence", "told for none" if np.isnan(confidence).any() else _spread(confidence)),
    ]
    kinds = zip(artifact.attrs["kinds"], artifact.attrs["thresholds"], novelty.T, strict=True)
    rejection = [
        (kind, f"{_spread(values)}; rejects {100 * (values >= threshold).mean():.1f} % from {threshold:.4g} on")
        for kind, threshold, values in kinds
    ]
    warnings = []
    if (np.diff(costs, axis=1) < 0).any():
        warnings.append("costs do not rise along the ranks: the method ranked wrongly, and its recall means nothing")
    if len(places) > 1 and _distinct(places[:, 0]) == 1:
        warnings.append("every query gets the same first answer: the model learned nothing, or the views are blank")
    return Highlights((Section("", tuple(rows)), Section("novelty, the first kind in use", tuple(rejection))), tuple(warnings))


def evaluations(artifact: Artifact) -> Highlights:
    """How it fared, by both protocols."""
    evaluation = Evaluation.read(artifact)
    numbers, attrs = summary(evaluation), artifact.attrs
    rows = [
        ("queries", f"{len(evaluation.answer):,}"),
        ("trained", f"on {attrs['train']}, tested on {attrs['sequence']}, {evaluation.days} days later"),
        ("threshold", f"{evaluation.reject_from[0]:.4g} on {evaluation.kinds[0]}"),
    ]
    sections = [Section("", tuple(rows))]
    sections += [Section(f"by {name}", _protocol(evaluation.protocol(name), numbers[name])) for name in PROTOCOLS]
    blind = [name for name in PROTOCOLS if len(evaluation.answer) and not evaluation.protocol(name).seen.any()]
    warnings = (f"no query was seen in training by {' or '.join(blind)}: recall and AUC mean nothing there",) if blind else ()
    return Highlights(tuple(sections), warnings)


def _protocol(judgement: Judgement, numbers: dict[str, float | None]) -> tuple[tuple[str, str], ...]:
    def told(name: str) -> str:
        _, low, high = judgement.numbers[NUMBERS.index(name)]
        between = f" ({low:.3f}–{high:.3f})" if low <= high else ""
        return "none" if numbers[name] is None else f"{numbers[name]:.3f}{between}"

    judged = f"{int(judgement.seen.sum()):,} seen and {int(judgement.unseen.sum()):,} unseen"
    outcomes = np.bincount(judgement.outcome, minlength=len(OUTCOMES))
    rows = (
        ("queries", judged),
        ("recall", ", ".join(f"at {n} {told(f'recall_at_{n}')}" for n in (1, 5, 25)) + " of the seen, none rejected"),
        ("oracle", f"{told('oracle')}: the nearest training anchor's answer"),
        ("AUC", ", ".join(f"top {n} {told(f'auc_top{n}')}" for n in (1, 5, 25)) + f", exact {told('auc_exact_top1')}"),
        ("heading", f"median error {told('median_heading_error_deg')}°, within 10° {told('heading_within_10deg')} of the right"),
        ("rejection", f"AUROC {told('auroc')}, recall at 99 % precision {told('recall_at_99_precision')}"),
        ("outcome", ", ".join(f"{count:,} {name}" for name, count in zip(OUTCOMES, outcomes, strict=True)) + " at the threshold"),
    )
    return tuple(row for row in rows if row[0] != "heading" or numbers["heading_within_10deg"] is not None)


def _spread(values: NDArray[Any]) -> str:
    low, mid, high = np.percentile(values, (5, 50, 95))
    return f"5 % {low:.3g}, median {mid:.3g}, 95 % {high:.3g}"


def _distinct(values: NDArray[Any]) -> int:
    return len(np.unique(values))
