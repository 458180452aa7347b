"""The studies of the SCI paper's section V as sections of a report: headings (Fig. 10), structure (Fig. 9), stress."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.evaluation.robustness import Robustness
from pipeline.reports import robustness_wording as wording
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_structure import construction, demolition
from pipeline.reports.robustness_studies import at_a_glance, headings, stressed
from pipeline.reports.robustness_told import Study, Told
from pipeline.reports.section import Section

TELL: Mapping[str, Callable[[Study], Told]] = {
    "turned": headings,
    "demolition": demolition,
    "construction": construction,
    "as_driven": stressed,
    "glance": at_a_glance,
}
"""What tells of each alteration; another one is shown at a glance."""


def section(
    folder: Path,
    name: str,
    dataset: str,
    grid: str,
    alteration: str,
    judged: Mapping[str, Sequence[Mapping[str, Robustness]]],
    simulated: bool,
    sources: Sequence[str],
    parameters: Mapping[str, Any],
) -> Section:
    """Draw the figures of one alteration into `folder` and tell of them; `judged` is model to seeds to sequence to Robustness.

    `parameters["stress"]` may say what makes a sequence hard. Raises InputError where nothing was judged.
    """
    answers = Answers(judged)
    study = Study(folder, dataset, answers, simulated, parameters.get("stress", {}))
    told = TELL.get(alteration, at_a_glance)(study)
    findings = (*told.answer, wording.setup(answers, dataset, grid, simulated, parameters))
    return Section(
        name,
        f"{told.title}: {dataset}, {grid} cells",
        told.question,
        tuple(filter(None, findings)),
        simulated,
        tuple(told.figures),
        tuple(told.tables),
        tuple(sources),
        parameters,
    )
