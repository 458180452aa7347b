"""What the numbers say, in sentences made of the numbers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.paired import COMPARED
from pipeline.reports.comparison import HEADINGS, Against
from pipeline.reports.rejection import of
from pipeline.reports.result import Result, by_method
from pipeline.reports.table import mean, signed


def novelties(results: Sequence[Result], protocol: str) -> list[str]:
    """A sentence or two a method: which kind of novelty told unseen from seen best, and which kept the wanted precision best."""
    told = []
    for method, group in by_method(results).items():
        kinds = group[0].evaluation.kinds
        auroc = np.stack([of(result, protocol, "auroc") for result in group])  # (sequence, kind, 3)
        area = np.stack([of(result, protocol, "auc_exact_top1") for result in group])[:, :, 0]
        precision = np.stack([of(result, protocol, "precision_at_threshold") for result in group])
        recall = np.stack([of(result, protocol, "recall_at_threshold") for result in group])[:, :, 0]
        wanted = group[0].wanted_precision if protocol == "cells" else None  # thresholds are chosen by cells
        parts = [_best(kinds, auroc), _largest(kinds, area), _kept(kinds, precision[:, :, 0], recall, wanted)]
        if any(parts):
            told.append(f"`{method}`, by {protocol}: {' '.join(filter(None, parts))}")
    return told


def comparisons(tested: Sequence[Against], protocol: str) -> list[str]:
    """A sentence a method: where it is surely better than the reference, and where worse."""
    groups: dict[str, list[Against]] = {}
    for one in tested:
        if one.protocol == protocol:
            groups.setdefault(one.result.method, []).append(one)
    return [
        f"`{method}` against `{group[0].reference}`, by {protocol}: "
        + "; ".join(_against(group, i, name) for i, name in enumerate(COMPARED))
        + "."
        for method, group in groups.items()
    ]


def _against(group: Sequence[Against], i: int, name: str) -> str:
    """`recall@1 +0.021 on average, better on 2 of 5 sequences (2012-02-04, 2012-03-17), undecided on 3`."""
    where: dict[str, list[str]] = {"better": [], "worse": [], "undecided": []}
    for one in group:
        where[one.verdict(name)].append(one.result.sequence[:10])
    parts, number = [], len(group)
    for verdict, days in where.items():
        if len(days) == number:
            parts = [f"{verdict} on {'the one sequence' if number == 1 else f'all {number} sequences'}"]
        elif days:
            named = f" ({', '.join(days)})" if verdict != "undecided" else ""
            parts.append(f"{verdict} on {len(days)} of {number}{named}")
    average = signed(mean([one.paired.differences[i].value for one in group]), 3)
    return f"{HEADINGS[name]} {average} on average, {', '.join(parts)}"


def _best(kinds: Sequence[str], auroc: NDArray[np.float64]) -> str:
    """The kind of highest mean AUROC against the one in use; (sequence, kind, 3)."""
    there = np.isfinite(auroc[:, :, 0]).all(axis=1)
    if not there.any():
        return ""
    value, low, high = np.moveaxis(auroc[there], 2, 0)
    best, number = int(value.mean(axis=0).argmax()), len(value)
    mean = value.mean(axis=0)
    if len(kinds) == 1:
        return f"{kinds[0]} told unseen from seen with a mean AUROC of {mean[0]:.3f}."
    if best == 0:
        second = int(mean[1:].argmax()) + 1
        return (
            f"no other kind told unseen from seen better than {kinds[0]}, in use (mean AUROC {mean[0]:.3f};"
            f" next {kinds[second]}, {mean[second]:.3f})."
        )
    ahead, clear = int((value[:, best] > value[:, 0]).sum()), int((low[:, best] > high[:, 0]).sum())
    return (
        f"{kinds[best]} told unseen from seen best (mean AUROC {mean[best]:.3f} against {mean[0]:.3f} of {kinds[0]}, in use):"
        f" ahead in {ahead} of {number} sequences, by more than both 95 % intervals in {clear}."
    )


def _largest(kinds: Sequence[str], area: NDArray[np.float64]) -> str:
    """The kind of largest mean area under precision over recall, which misplaced queries count in; (sequence, kind)."""
    there = np.isfinite(area).all(axis=1)
    if len(kinds) == 1 or not there.any():
        return ""
    mean = area[there].mean(axis=0)
    best = int(mean.argmax())
    against = f", {mean[0]:.3f} of {kinds[0]}" if best else ""
    return (
        f"Counting misplaced queries too, {kinds[best]} has the largest area under precision over recall"
        f" (mean exact AUC {mean[best]:.3f}{against})."
    )


def _kept(kinds: Sequence[str], precision: NDArray[np.float64], recall: NDArray[np.float64], wanted: float | None) -> str:
    """The kind whose thresholds missed the wanted precision least; (sequence, kind)."""
    usable = np.isfinite(precision).all(axis=0)
    if wanted is None or not usable.any():
        return ""
    miss = np.where(usable, np.abs(precision - wanted).mean(axis=0), np.inf)
    best = int(miss.argmin())
    which = f"Of the thresholds chosen for a precision of {wanted:g}, those of {kinds[best]} missed it least:"
    if len(kinds) == 1:
        which = f"Its threshold, chosen for a precision of {wanted:g}, missed it"
    return (
        f"{which} by {miss[best]:.3f} on"
        f" average; its lowest precision was {precision[:, best].min():.3f}, its mean recall {recall[:, best].mean():.3f}."
    )
