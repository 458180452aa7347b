"""What the studies of headings (Fig. 10 of the SCI paper), of stress and of a demo have to say."""

import numpy as np

from pipeline.alterations import Case
from pipeline.reports import robustness_figures as figures
from pipeline.reports import robustness_findings as findings
from pipeline.reports import robustness_lines as lines
from pipeline.reports import robustness_tables as tables
from pipeline.reports import robustness_wording as wording
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_numbers import AUC, FAR, KEPT, OFF, RECALL
from pipeline.reports.robustness_told import BY_CELLS, BY_DISTANCE, Study, Told


def headings(study: Study) -> Told:
    """Fig. 10: queries that are turned by random angles."""
    answers, kind = study.answers, study.answers.kinds[-1]
    measures = (AUC, KEPT, FAR, OFF) if _tells(answers, kind) else (AUC, KEPT, FAR)
    fig = figures.dots(answers, measures, kind, study.simulated, f"Queries turned by random angles, {study.where}")
    shown = [
        study.shown(
            "turned", fig, "As driven and turned (Fig. 10)",
            "Hollow: as driven; filled: turned; the longer the line between them, the more a turn costs. *AUC kept* is the AUC"
            " turned over that as driven, 1 where nothing is lost; bars are deviations over the test sequences.",
            wording.kept(answers, kind), wording.nearly_always(answers, kind), wording.heading_errors(answers, kind),
            wording.chance(answers, kind),
        )
    ]  # fmt: skip
    if len(answers.ways()) > 1:
        others = [model for model in ("sci_ring", "scan_context") if model in answers.judged]
        fig = lines.ways(answers, kind, others, study.simulated, f"SCI trained N ways, {study.where}")
        shown.append(
            study.shown(
                "ways", fig, "How many ways SCI has to be trained",
                "N copies of each training image, turned by 360°/N: where the full line meets the dashed one, a turn costs"
                " nothing. Dotted lines are other models, turned.",
                findings.n_ways(answers, kind),
            )
        )  # fmt: skip
    return Told(
        "Headings",
        "How well is a place known again when the robot stands in it at any heading?",
        (
            wording.leaders(answers, kind, AUC),
            findings.papers_way(answers, kind),
            findings.rivals(answers, kind, AUC),
            wording.CLEARLY,
        ),
        shown,
        (
            (BY_CELLS, tables.every_case(answers, tables.BY_CELLS)),
            (BY_DISTANCE, tables.every_case(answers, tables.BY_DISTANCE)),
            (
                "AUC top-1 by cells, turned, on each sequence (± over the repeats)",
                tables.by_sequence(answers, kind, AUC),
            ),
        ),
    )


def stressed(study: Study) -> Told:
    """Sequences that are hard as they are."""
    answers = study.answers
    named = {one: ", ".join(filter(None, (one[:10], str(study.stress.get(one, ""))))) for one in answers.sequences}
    fig = figures.sequences(answers, named, study.simulated, f"Sequences of stress, {study.where}")
    shown = study.shown(
        "stress", fig, "Each sequence of stress",
        "A row a model, in one order for all sequences, the best on average above; bars are deviations over seeds, of models that"
        " have several.",
        findings.rivals_on_each(answers, RECALL), wording.nearly_always(answers, Case()), wording.chance(answers, Case()),
    )  # fmt: skip
    rivals = findings.rivals(answers, Case(), RECALL)
    return Told(
        "Stress",
        "How well are places known again on drives that are made to be hard?",
        (wording.leaders(answers, Case(), RECALL), findings.on_each(answers, named), rivals, wording.CLEARLY),
        [shown],
        (("Each sequence and model (± over seeds)", tables.stress(answers, named)),),
    )


def at_a_glance(study: Study) -> Told:
    """A case or two of several alterations side by side."""
    answers = study.answers
    fig = figures.dots(answers, (AUC, KEPT, FAR), Case(), study.simulated, f"Altered queries at a glance, {study.where}")
    shown = study.shown(
        "glance", fig, "One case of each alteration",
        "A row a model, a marker a case: the closer its markers, the less it minds. *AUC kept* is the AUC over that as driven;"
        " bars are deviations over the test sequences.",
        *(wording.kept(answers, kind) for kind in answers.changes),
    )  # fmt: skip
    few = "This is a glance at few sequences and one case of each: small differences mean nothing."
    return Told(
        "Robustness at a glance",
        "What becomes of the answers when the robot is turned, or the site rebuilt?",
        (*(wording.leaders(answers, kind, AUC) for kind in answers.kinds), few),
        [shown],
        (
            (BY_CELLS, tables.every_case(answers, tables.BY_CELLS)),
            (BY_DISTANCE, tables.every_case(answers, tables.BY_DISTANCE)),
        ),
    )


def _tells(answers: Answers, kind: Case) -> bool:
    """Some model tells a heading."""
    return any(np.isfinite(answers.found(model, kind, OFF).mean) for model in answers.models)
