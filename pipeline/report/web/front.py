"""The first screen of a study on the page: its best model, how it ages, and how others compare.

In: a study of the year or of robustness. Out: the values that templates/page.html.j2 shows, with
tables and two charts among them.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.core.precisions import JUDGED_PRECISION, kept_words, shown
from pipeline.report import findings, tables
from pipeline.report.comparison import RECALL_BY_DISTANCE
from pipeline.report.figures import curves
from pipeline.report.figures.style import Link, inline
from pipeline.report.render import percent, words
from pipeline.report.result import Result, by_model, dates, ranked
from pipeline.report.section import anchor
from pipeline.report.study import StudyResults
from pipeline.studies.colours import method_of
from pipeline.studies.study import Study as StudySettings

# Numbers of the table of results whose sums over the test days are shown.
COUNTED = ("accepted", "accepted_wrong", "refused", "refused_wrong", "no_pose_99")


def front(study: StudyResults) -> dict[str, Any]:
    """The values on the first screen of one study at one cell size.

    Models that had too little training to be compared are folded away, with the share that they
    had. The best model's own method stays: with more training it would be no worse.
    """
    models = ranked(study.results)
    best = models[study.best]
    folded = {
        model: share
        for model, share in study.cut_short.items()
        if method_of(model) != method_of(study.best)
    }
    compared = {model: group for model, group in models.items() if model not in folded}
    results = [result for group in compared.values() for result in group]
    cards = [results, [result for model in folded for result in models[model]]]
    days = list(dates(study.results).values())
    compared_model, baseline = rivals(study.settings, study.best, list(compared))
    return {
        "study": study,
        "best": best,
        # in a study that is not of the year, the report has no variants without poses
        "own": models.get(compared_model) or models[method_of(compared_model)],
        "baseline": models.get(baseline),
        "folded": folded,
        "dates": days,
        # sums over the test days; 0 for a number that the results do not have
        "counted": {
            number: int(np.nansum([result.number("distance", number) for result in best]))
            for number in COUNTED
        },
        "accepted": tables.accepted(best),
        "kept": None if best[0].kept_precision is None else shown(best[0].kept_precision),
        "kept_words": _kept_words(best[0]),
        "year": _year(study, results, len(days)),
        "knows": _knows(study, results),
        "scorecards": [tables.scorecard(card) for card in cards if card],
        "perturbed": tables.perturbed(study, models),
        "caveats": findings.caveats(study),
    }


def _kept_words(result: Result) -> str | None:
    """A line that says which precision accepted poses keep, if it is not .99."""
    if not result.keeps_nothing and result.kept_precision is None:
        return None  # answers without poses have no target precision of poses
    reachable = [] if result.kept_precision is None else [result.kept_precision]
    return kept_words(f"`{result.model}`", reachable, JUDGED_PRECISION)


def rivals(settings: StudySettings, best: str, compared: Sequence[str]) -> tuple[str, str]:
    """The best model, and the first of the compared baselines with the same kind of answers.

    Answers with poses are compared with answers with poses. If no baseline has poses, the best
    model is compared without its poses. A baseline is a method of another family: the methods of a
    family begin with the same word, as `sci_ring` and `sci` do. A method with its own settings goes
    before its variants, which are ours and count only if they have poses. Empty without a
    baseline.
    """
    named = {answerer.name: answerer for answerer in settings.answerers}
    family = method_of(best).partition("_")[0]
    others = [named[model] for model in compared if method_of(model).partition("_")[0] != family]
    others.sort(key=lambda other: bool(other.variant))
    for plainer in named[best].plainer:
        for other in others:
            is_same_kind = (other.posed, other.path) == (plainer.posed, plainer.path)
            if is_same_kind and (plainer.posed or not other.variant):
                return plainer.name, other.name
    return best, ""


def _year(study: StudyResults, results: list[Result], days: int) -> Markup:
    """A chart of each model's share of right answers over the days since training."""
    draw = partial(inline, simulated=study.simulated, name=anchor(study.name, study.grid, "year"))
    if days == 1:
        return draw(curves.recall_at(results), links={})
    share = {result.id: result.number("distance", "recall_at_1") for result in results}
    links = {
        r.id: Link(r.model, r.sequence, f"{r.model}, {r.label}: {percent(share[r.id], 1)} right")
        for r in results
    }
    return draw(
        curves.year(results, study.train, (RECALL_BY_DISTANCE,), curves.PAGE_IN), links=links
    )


def _knows(study: StudyResults, results: list[Result]) -> Markup:
    """A chart of the last day: the share of queries that can be answered at each precision."""
    last = [group[-1] for group in by_model(results).values()]
    links = {
        result.id: Link(result.model, result.sequence, words("front", "threshold", result=result))
        for result in last
    }
    name = anchor(study.name, study.grid, "knows")
    return inline(curves.coverage(last), study.simulated, name, links)
