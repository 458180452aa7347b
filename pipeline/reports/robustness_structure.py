"""What the studies of structure have to say (Fig. 9 of the SCI paper): a wedge of directions gone, or new walls."""

from pipeline.reports import robustness_findings as findings
from pipeline.reports import robustness_lines as lines
from pipeline.reports import robustness_tables as tables
from pipeline.reports import robustness_wording as wording
from pipeline.reports.robustness_numbers import AUC, FAR, KEPT
from pipeline.reports.robustness_told import BY_CELLS, BY_DISTANCE, OVER, Study, Told


def demolition(study: Study) -> Told:
    """Fig. 9, first half: a wedge of directions is gone."""
    question = "How well is a place known again when a part of what stood there is gone?"
    return _structure(study, "Demolition", question, "degrees removed")


def construction(study: Study) -> Told:
    """Fig. 9, second half: new walls."""
    return _structure(study, "Construction", "How well is a place known again when new walls stand in it?", "new walls")


def _structure(study: Study, title: str, question: str, unit: str) -> Told:
    answers = study.answers
    worst = max(answers.changes, key=lambda kind: (kind.level, kind.shadow))
    fig = lines.levels(answers, study.simulated, f"{title}, {study.where}", unit)
    shown = study.shown(
        title.lower(), fig, f"{title} (Fig. 9)",
        "One line a model, from as driven on the left to the most that was changed on the right: who stays level bears it."
        " *AUC kept* is the AUC over that as driven; bars are deviations over the test sequences.",
        wording.kept(answers, worst), findings.shadows(answers), wording.nearly_always(answers, worst),
        wording.chance(answers, worst),
    )  # fmt: skip
    return Told(
        title,
        question,
        (
            wording.leaders(answers, worst, AUC),
            findings.rivals(answers, worst, AUC),
            findings.rivals(answers, worst, KEPT),
            "The paper gives no sizes of its changes, so the order of the methods is all that can be compared with it.",
            wording.CLEARLY,
        ),
        [shown],
        (
            (f"AUC top-1 by cells ({OVER})", tables.over_kinds(answers, AUC)),
            (f"AUC as a share of that as driven ({OVER})", tables.over_kinds(answers, KEPT)),
            (f"recall@1 by distance ({OVER})", tables.over_kinds(answers, FAR)),
            (BY_CELLS, tables.every_case(answers, tables.BY_CELLS)),
            (BY_DISTANCE, tables.every_case(answers, tables.BY_DISTANCE)),
        ),
    )
