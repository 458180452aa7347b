"""Whether the SCI paper's findings show in a study of robustness, and how our ring, SCI and Scan Context compare."""

from collections.abc import Mapping

import numpy as np

from pipeline.alterations import Case
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_numbers import AUC, KEPT, RECALL, Margin, Measure, label
from pipeline.reports.robustness_wording import WHOLE, told, where
from pipeline.reports.table import mean, number, signed, spread

PAPERS_WAY = 4


def papers_way(answers: Answers, kind: Case) -> str:
    """Whether 4-way augmentation suffices for arbitrary headings and keeps normal performance, as the paper finds."""
    claim = f"The paper finds that {PAPERS_WAY}-way training suffices for arbitrary headings and keeps normal performance"
    ways = answers.ways()
    share = answers.found(ways[PAPERS_WAY], kind, KEPT).mean if PAPERS_WAY in ways else np.nan
    if np.isnan(share) or len(ways) == 1:
        return f"{claim}: without an AUC of `sci` trained {PAPERS_WAY} and other ways, that is not tested here."
    four = ways[PAPERS_WAY]
    more = {n: answers.ahead(model, four, kind, AUC) for n, model in ways.items() if n > PAPERS_WAY}
    better = [n for n, margin in more.items() if margin.clear and margin.value > 0]
    fewer = {n: answers.ahead(four, model, Case(), AUC) for n, model in ways.items() if n < PAPERS_WAY}
    worse = [n for n, margin in fewer.items() if margin.clear and margin.value < 0]
    suffices, keeps = share >= WHOLE and not better, bool(fewer) and not worse
    verdict = {
        (True, True): "both show here",
        (True, False): "the first shows here, the second does not",
        (False, True): "the second shows here, the first does not",
        (False, False): "neither shows here",
    }[suffices, keeps]
    if max(margin.number for margin in (*more.values(), *fewer.values())) < 2:
        verdict = "one sequence does not decide it"
    larger = ", ".join(f"{n}-way {_apart(margin)}" for n, margin in more.items())
    smaller = ", ".join(f"against {n}-way {_apart(margin)}" for n, margin in fewer.items())
    return (
        f"{claim}: {verdict}. Turned, it keeps {share:.0%} of its AUC by cells"
        + (f"; more ways add: {larger}" if larger else "")
        + f". As driven it has {told(answers.found(four, Case(), AUC))}"
        + (f", {smaller}." if smaller else ".")
    )


def n_ways(answers: Answers, kind: Case) -> str:
    """SCI's AUC over N, one after the other."""
    shown = [
        f"{n}-way {number(answers.found(model, kind, AUC).mean, 3)} of {number(answers.found(model, Case(), AUC).mean, 3)}"
        for n, model in answers.ways().items()
    ]
    return f"AUC by cells {where(kind)}, of that as driven: {', '.join(shown)}."


def rivals(answers: Answers, kind: Case, measure: Measure) -> str:
    """Our ring against the best SCI and against Scan Context, and that SCI against Scan Context."""
    best = [model for model in answers.ordered(kind, measure) if model.partition("-")[0] == "sci"][:1]
    pairs = [("sci_ring", other) for other in (*best, "scan_context")] + [(one, "scan_context") for one in best]
    parts = [
        f"`{one}` against `{other}` {_apart(answers.ahead(one, other, kind, measure))}"
        for one, other in pairs
        if one in answers.judged and other in answers.judged
    ]
    chosen = "; of SCI's models the best here was taken" if best and len(answers.ways()) > 1 else ""
    return f"In {measure.title}, {where(kind)}: {', '.join(parts)}{chosen}." if parts else ""


def rivals_on_each(answers: Answers, measure: Measure) -> str:
    """On how many sequences our ring is ahead as driven."""
    ours = answers.found("sci_ring", Case(), measure).by_sequence if "sci_ring" in answers.judged else np.empty(0)
    told = []
    for other in [model for model in answers.models if model != "sci_ring"] if len(ours) else []:
        apart = ours - answers.found(other, Case(), measure).by_sequence
        apart = apart[np.isfinite(apart)]
        told += [f"`{other}` on {(apart > 0).sum()} of {len(apart)}"] if len(apart) else []
    return f"In {measure.title}, `sci_ring` is ahead of {', '.join(told)}." if told else ""


def shadows(answers: Answers) -> str:
    """What it changes to hide what lies behind the new walls."""
    hidden = [kind for kind in answers.changes if kind.shadow and Case(kind.change, kind.level) in answers.kinds]
    if not hidden:
        return ""
    worst = max(hidden, key=lambda kind: kind.level)
    bare = Case(worst.change, worst.level)
    apart = [answers.ahead(model, model, worst, AUC, bare).value for model in answers.models]
    lower = int((np.array(apart) < 0).sum())
    return (
        f"Hiding what lies behind {label(bare)} changes the AUC by {signed(mean(apart), 3)} on average over the models,"
        f" downwards for {lower} of {len(apart)}."
    )


def on_each(answers: Answers, named: Mapping[str, str]) -> str:
    """The best two models on each sequence as driven."""
    parts = []
    for i, sequence in enumerate(answers.sequences):
        found = {model: answers.found(model, Case(), RECALL).on(i) for model in answers.models}
        first = sorted((model for model in found if np.isfinite(found[model].mean)), key=lambda model: -found[model].mean)[:2]
        best = [f"`{model}` {spread(list(found[model].by_seed), 3)}" for model in first]
        parts.append(f"{named[sequence]}, {' before '.join(best) or 'none'}")
    return f"Highest recall@1 by cells: {'; '.join(parts)}; ± over seeds."


def _apart(margin: Margin) -> str:
    """`+0.031 ± .012 (clear)`."""
    if not margin.number:
        return "not comparable"
    around = f" ± {margin.over_sequences:.3f}".replace("0.", ".") if margin.number > 1 else ""
    return f"{signed(margin.value, 3)}{around} ({'clear' if margin.clear else 'not clear'})"
