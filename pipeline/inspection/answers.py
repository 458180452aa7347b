"""Key numbers of the artifacts with a row per query: labels, rankings, evaluations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Labels, Rankings
from pipeline.evaluation.judgement import Evaluations, Judgement, summary
from pipeline.evaluation.numbers import NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.inspection import Inspection, metres

OUTCOMES = ("hits", "misses", "false alarms", "correct rejections", "not judged")


def labels(artifact: Labels, inspection: Inspection) -> None:
    """Add the share of the sequence that lies in places of training."""
    places = artifact.places
    nearest_m = artifact.nearest_m
    seen = places >= 0
    rows = [
        ("submaps", f"{len(places):,}"),
        (
            "places",
            f"{len(artifact.cells):,} of training, {_distinct(places[seen]):,} met here",
        ),
    ]
    if len(places):
        rows += [
            (
                "seen",
                f"{int(seen.sum()):,} submaps ({100 * seen.mean():.1f} %), unseen "
                f"{int((~seen).sum()):,}",
            ),
            (
                "nearest",
                f"training anchor: median {metres(np.median(nearest_m))}, farthest "
                f"{metres(nearest_m.max())}",
            ),
        ]
    if seen.any():
        share = f"{100 * (artifact.oracle == places)[seen].mean():.1f} %"
        rows.append(
            ("oracle", f"{share} of the seen have their nearest training anchor in their place")
        )
    inspection.add("", *rows)
    no_overlap = (
        "no submap lies in a place of training: do both sequences share one world frame, and the "
        "grid's box?"
    )
    inspection.warn(len(places) and not seen.any(), no_overlap)


def rankings(artifact: Rankings, inspection: Inspection) -> None:
    """Add numbers on the answers of the method, which are not compared with the truth."""
    places = artifact.places
    confidence = artifact.confidence
    rows = [("queries", f"{len(places):,}, {places.shape[1]} places each")]
    if not len(places):
        inspection.add("", *rows)
        return
    answers = _distinct(places[:, 0])
    heading_share = np.isfinite(artifact.heading_deg[:, 0]).mean()
    inspection.add(
        "",
        *rows,
        ("first answers", f"{answers:,} distinct places"),
        ("heading", f"estimated for {100 * heading_share:.3g} % of the queries"),
        ("confidence", "none" if np.isnan(confidence).any() else _spread(confidence)),
    )
    kinds = zip(artifact.kinds, artifact.thresholds, artifact.novelty.T, strict=True)
    rejection = [
        (
            kind,
            f"{_spread(values)}; rejects {100 * (values >= threshold).mean():.1f} % from "
            f"{threshold:.4g} on{shortfall}",
        )
        for (kind, threshold, values), shortfall in zip(kinds, _shortfalls(artifact), strict=True)
    ]
    inspection.add("novelty, the first kind in use", *rejection)
    costs_fall = (np.diff(artifact.costs, axis=1) < 0).any()
    inspection.warn(
        costs_fall,
        "costs do not rise along the ranks: the method ranked wrongly, and its recall means "
        "nothing",
    )
    constant_answer = (
        "every query gets the same first answer: the model learned nothing, or the views are blank"
    )
    inspection.warn(len(places) > 1 and answers == 1, constant_answer)


def _shortfalls(artifact: Rankings) -> list[str]:
    """A text for each threshold whose precision on held-out blocks is below the wanted one.

    Empty for the others.
    """
    wanted_precision = artifact.wanted_precision
    return [
        f"; keeps {precision:.3f} of the wanted {wanted_precision:g} on held-out blocks"
        if precision < wanted_precision
        else ""
        for precision in artifact.kept_precision
    ]


def evaluations(artifact: Evaluations, inspection: Inspection) -> None:
    """Add the results of the evaluation, by both protocols."""
    evaluation = artifact.case()
    numbers = summary(evaluation)
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
        inspection.add(f"by {name}", *_protocol(evaluation.protocol(name), numbers[name]))
    blind_protocols = [
        name
        for name in PROTOCOLS
        if len(evaluation.answer) and not evaluation.protocol(name).seen.any()
    ]
    inspection.warn(
        blind_protocols,
        f"no query was seen in training by {' or '.join(blind_protocols)}: recall and AUC mean "
        "nothing there",
    )


def _protocol(judgement: Judgement, numbers: dict[str, float | None]) -> list[tuple[str, str]]:
    def number(name: str) -> str:
        _, low, high = judgement.numbers[NUMBERS.index(name)]
        between = f" ({low:.3f}–{high:.3f})" if low <= high else ""
        return "none" if numbers[name] is None else f"{numbers[name]:.3f}{between}"

    median = number("median_heading_error_deg")
    within = number("heading_within_10deg")
    heading = ("heading", f"median error {median}°, within 10° {within} of the right")
    outcomes = zip(np.bincount(judgement.outcome, minlength=len(OUTCOMES)), OUTCOMES, strict=True)
    return [
        (
            "queries",
            f"{int(judgement.seen.sum()):,} seen and {int(judgement.unseen.sum()):,} unseen",
        ),
        (
            "recall",
            ", ".join(f"at {n} {number(f'recall_at_{n}')}" for n in (1, 5, 25))
            + " of the seen, none rejected",
        ),
        ("oracle", f"{number('oracle')}: the nearest training anchor's answer"),
        (
            "AUC",
            ", ".join(f"top {n} {number(f'auc_top{n}')}" for n in (1, 5, 25))
            + f", exact {number('auc_exact_top1')}",
        ),
        *([heading] if numbers["heading_within_10deg"] is not None else []),
        (
            "rejection",
            f"AUROC {number('auroc')}, recall at 99 % precision {number('recall_at_99_precision')}",
        ),
        (
            "outcome",
            ", ".join(f"{count:,} {name}" for count, name in outcomes) + " at the threshold",
        ),
    ]


def _spread(values: NDArray[Any]) -> str:
    return "5 % {:.3g}, median {:.3g}, 95 % {:.3g}".format(*np.percentile(values, (5, 50, 95)))


def _distinct(values: NDArray[Any]) -> int:
    return len(np.unique(values))
