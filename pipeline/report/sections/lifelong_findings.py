"""What learning further days shows, as data: what growth forgets and lacks, and what a site regains
by itself."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pipeline.report.findings import Finding
from pipeline.report.sections.lifelong_numbers import (
    GROWN,
    JOINT,
    PROTOCOL,
    TUNED,
    UPDATES,
    StrategyNumbers,
)
from pipeline.report.table import average


def findings(every: Sequence[StrategyNumbers]) -> list[Finding]:
    """Of each model those that its strategies allow: what growth forgets, what it lacks, what a
    site regains by itself."""
    models = {
        model: [one for one in every if one.model == model]
        for model in dict.fromkeys(one.model for one in every)
    }
    about = {"protocol": PROTOCOL, "strategy": GROWN}
    found = []
    for model, own in models.items():
        if listed := against(own, "forgetting", TUNED):
            found.append(
                Finding("growth_forgets", model=model, reference=TUNED, listed=listed, **about)
            )
    for model, own in models.items():
        if listed := against(own, "recall_of_all", JOINT):
            found.append(
                Finding("below_joint", model=model, reference=JOINT, listed=listed, **about)
            )
    return [*found, *(one for own in models.values() for one in regained(own))]


def against(every: Sequence[StrategyNumbers], number: str, reference: str) -> list[dict[str, Any]]:
    """One model's growth and a reference in each order, after the last step: means over the seeds
    of both; the mean, lowest and highest difference on the same seed."""
    known = {(one.order, one.strategy): one for one in every}
    listed = []
    for order in dict.fromkeys(one.order for one in every):
        if (order, GROWN) in known and (order, reference) in known:
            own, theirs = (
                known[order, strategy].last(number, PROTOCOL) for strategy in (GROWN, reference)
            )
            apart = own - theirs
            ends = {"low": float(apart.min()), "high": float(apart.max()), "seeds": len(apart)}
            listed.append(
                {
                    "order": order,
                    "own": average(own),
                    "reference": average(theirs),
                    "apart": average(apart),
                    **ends,
                }
            )
    return listed


def regained(every: Sequence[StrategyNumbers]) -> Iterator[Finding]:
    """One model's recall on the day that is asked last and on average, before and after days that
    nobody surveyed; and how many scans were adopted, and at a wrong pose."""
    updates = [one for one in every if one.order == UPDATES]
    listed = []
    for one in updates:
        recall = one.over("recall_at_1", PROTOCOL, one.groups[-1])
        means = one.over("mean_recall", PROTOCOL)
        counts = {
            name: average(np.nansum(one.over(name), axis=1))
            for name in ("asked", "adopted", "wrong")
        }
        ends = {
            "before": average(recall[:, 0]),
            "after": average(recall[:, -1]),
            "digits": int(counts["wrong"] % 1 > 0),
        }
        listed.append(
            {
                "strategy": one.strategy,
                "means": [average(means[:, 0]), average(means[:, -1])],
                **ends,
                **counts,
            }
        )
    for one in updates[:1]:
        yield Finding(
            "regained",
            model=one.model,
            protocol=PROTOCOL,
            last=one.groups[-1],
            seeds=len(one.seeds),
            listed=listed,
        )
