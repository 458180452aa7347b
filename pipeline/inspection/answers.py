"""Key numbers of the artifacts on the places of queries: labels, rankings, evaluations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.judgement import Evaluation, Judgement, summary
from pipeline.evaluation.numbers import NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.inspection import Findings, Section, metres
from pipeline.store import Artifact

OUTCOMES = ("hits", "misses", "false alarms", "correct rejections", "not judged")


def labels(artifact: Artifact) -> Findings:
    """The share of the sequence that lies in places of training."""
    places, oracle, nearest = (artifact.load(name) for name in ("places", "oracle", "nearest_m"))
    seen = places >= 0
    rows = [
        ("submaps", f"{len(places):,}"),
        ("places", f"{artifact['cells'].shape[0]:,} of training, {_distinct(places[seen]):,} met here"),
    ]
    warnings = []
    if len(places):
        rows.append(("seen", f"{int(seen.sum()):,} submaps ({100 * seen.mean():.1f} %), unseen {int((~seen).sum()):,}"))
        median, farthest = metres(float(np.median(nearest))), metres(float(nearest.max()))
        rows.append(("nearest", f"training anchor: median {median}, farthest {farthest}"))
    if seen.any():
        share = f"{100 * (oracle == places)[seen].mean():.1f} %"
        rows.append(("oracle", f"{share} of the seen have their nearest training anchor in their place"))
    elif len(places):
        warnings.append("no submap lies in a place of training: do both sequences share one world frame, and the grid's box?")
    return Findings((Section("", tuple(rows)),), tuple(warnings))


def rankings(artifact: Artifact) -> Findings:
    """The answers of the method, not compared with the truth."""
    places, costs, novelty, confidence = (artifact.load(name) for name in ("places", "costs", "novelty", "confidence"))
    rows = [("queries", f"{len(places):,}, {places.shape[1]} places each")]
    if not len(places):
        return Findings((Section("", tuple(rows)),))
    known = np.isfinite(artifact.load("heading_deg")).mean()
    rows += [
        ("first answers", f"{_distinct(places[:, 0]):,} distinct places"),
        ("heading", f"estimated for {100 * known:.3g} % of the queries"),
        ("confidence", "none" if np.isnan(confidence).any() else _spread(confidence)),
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
    return Findings((Section("", tuple(rows)), Section("novelty, the first kind in use", tuple(rejection))), tuple(warnings))


def evaluations(artifact: Artifact) -> Findings:
    """The results of the evaluation, by both protocols."""
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
    return Findings(tuple(sections), warnings)


def _protocol(judgement: Judgement, numbers: dict[str, float | None]) -> tuple[tuple[str, str], ...]:
    def number(name: str) -> str:
        _, low, high = judgement.numbers[NUMBERS.index(name)]
        between = f" ({low:.3f}–{high:.3f})" if low <= high else ""
        return "none" if numbers[name] is None else f"{numbers[name]:.3f}{between}"

    judged = f"{int(judgement.seen.sum()):,} seen and {int(judgement.unseen.sum()):,} unseen"
    outcomes = np.bincount(judgement.outcome, minlength=len(OUTCOMES))
    rows = (
        ("queries", judged),
        ("recall", ", ".join(f"at {n} {number(f'recall_at_{n}')}" for n in (1, 5, 25)) + " of the seen, none rejected"),
        ("oracle", f"{number('oracle')}: the nearest training anchor's answer"),
        ("AUC", ", ".join(f"top {n} {number(f'auc_top{n}')}" for n in (1, 5, 25)) + f", exact {number('auc_exact_top1')}"),
        (
            "heading",
            f"median error {number('median_heading_error_deg')}°, within 10° {number('heading_within_10deg')} of the right",
        ),
        ("rejection", f"AUROC {number('auroc')}, recall at 99 % precision {number('recall_at_99_precision')}"),
        ("outcome", ", ".join(f"{count:,} {name}" for name, count in zip(OUTCOMES, outcomes, strict=True)) + " at the threshold"),
    )
    return tuple(row for row in rows if row[0] != "heading" or numbers["heading_within_10deg"] is not None)


def _spread(values: NDArray[Any]) -> str:
    low, mid, high = np.percentile(values, (5, 50, 95))
    return f"5 % {low:.3g}, median {mid:.3g}, 95 % {high:.3g}"


def _distinct(values: NDArray[Any]) -> int:
    return len(np.unique(values))
