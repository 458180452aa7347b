"""What learning further days shows, as data: what growth forgets and lacks, what a site regains."""

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


def findings(strategies: Sequence[StrategyNumbers]) -> list[Finding]:
    """For each model: what growth forgets, what it lacks, and what a site regains by itself.

    A model has the findings that its strategies allow.
    """
    models = {
        model: [strategy for strategy in strategies if strategy.model == model]
        for model in dict.fromkeys(strategy.model for strategy in strategies)
    }
    context = {"protocol": PROTOCOL, "strategy": GROWN}
    verdicts = []
    for model, model_strategies in models.items():
        if entries := against(model_strategies, "forgetting", TUNED):
            verdicts.append(
                Finding("growth_forgets", model=model, reference=TUNED, listed=entries, **context)
            )
    for model, model_strategies in models.items():
        if entries := against(model_strategies, "recall_of_all", JOINT):
            verdicts.append(
                Finding("below_joint", model=model, reference=JOINT, listed=entries, **context)
            )
    for model_strategies in models.values():
        verdicts += regained(model_strategies)
    return verdicts


def against(
    strategies: Sequence[StrategyNumbers], number: str, reference: str
) -> list[dict[str, Any]]:
    """Compare one model's growth with a reference strategy in each order, after the last step.

    Gives the means of both over the seeds, and the mean, lowest and highest difference on the same
    seed.
    """
    by_key = {(strategy.order, strategy.name): strategy for strategy in strategies}
    entries = []
    for order in dict.fromkeys(strategy.order for strategy in strategies):
        if (order, GROWN) in by_key and (order, reference) in by_key:
            grown_values, reference_values = (
                by_key[order, name].last(number, PROTOCOL) for name in (GROWN, reference)
            )
            differences = grown_values - reference_values
            ends = {
                "low": float(differences.min()),
                "high": float(differences.max()),
                "seeds": len(differences),
            }
            entries.append(
                {
                    "order": order,
                    "own": average(grown_values),
                    "reference": average(reference_values),
                    "apart": average(differences),
                    **ends,
                }
            )
    return entries


def regained(strategies: Sequence[StrategyNumbers]) -> Iterator[Finding]:
    """One model's recall before and after days that nobody surveyed.

    Recall is of the last asked day and on average. Adds how many scans were adopted, and at a wrong
    pose.
    """
    updates = [strategy for strategy in strategies if strategy.order == UPDATES]
    entries = []
    for strategy in updates:
        recall = strategy.over("recall_at_1", PROTOCOL, strategy.groups[-1])
        means = strategy.over("mean_recall", PROTOCOL)
        counts = {
            name: average(np.nansum(strategy.over(name), axis=1))
            for name in ("asked", "adopted", "wrong")
        }
        ends = {
            "before": average(recall[:, 0]),
            "after": average(recall[:, -1]),
            "digits": int(counts["wrong"] % 1 > 0),
        }
        entries.append(
            {
                "strategy": strategy.name,
                "means": [average(means[:, 0]), average(means[:, -1])],
                **ends,
                **counts,
            }
        )
    for strategy in updates[:1]:
        yield Finding(
            "regained",
            model=strategy.model,
            protocol=PROTOCOL,
            last=strategy.groups[-1],
            seeds=len(strategy.seeds),
            listed=entries,
        )
