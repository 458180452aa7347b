"""The sections of a study of the year: answer, set-up, results, figures, ageing and poses.

In: a study, and a function that makes the view of a name of conf/view. Out: the sections in the
report's order, with their figures drawn.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pipeline.core import store
from pipeline.core.schemas import VIEW_KINDS, ScanContextViews, Scans, Submaps, Views
from pipeline.evaluation.rows import pick
from pipeline.evaluation.study_rows import AGEING, PER_DAYS
from pipeline.mapping.gathering import submap_points
from pipeline.perturbations.construction import Construction
from pipeline.report import findings, tables
from pipeline.report.figures import (
    ageing,
    curves,
    maps,
    matches,
    rejection,
    verdicts,
    views,
)
from pipeline.report.result import Result, by_model
from pipeline.report.section import Illustration, Section, illustrate, section_of
from pipeline.report.study import StudyResults
from pipeline.report.tables import DISTANCE_FIRST, MAIN_NUMBERS
from pipeline.views.scan_context import ScanContext

# The kinds of figure that the page shows; a figure of one model is shown of the best model only.
ON_PAGE = (
    "year",
    "year_auc",
    "precision_recall",
    "recall_at",
    "montage",
    "novelty",
    "rejection",
    "reliability",
    "matches",
)
# Titles of the numbers that are followed over the days; the blank is for the protocol.
LINES = {
    "recall_at_1_same_heading": "recall@1, training's heading, by {}",
    "auc_top1": "AUC top-1, by {}",
    "auroc": "AUROC, by {}",
    "novelty_percentile": "novelty of the seen, percentile, by {}",
    "recall_at_1": "recall@1, by {}",
}
DRAWN = 4  # number of metrics that are drawn: the first of AGEING


def sections(study: StudyResults, folder: Path, view: Callable[[str], Any]) -> Iterator[Section]:
    """Draw every figure into `folder` and yield the sections in the report's order.

    `view` makes the view of a name of conf/view.
    """
    values = {
        "study": study,
        "tests": len(study.settings.tests),
        "places": int(study.labels["cells"].shape[0]),
    }
    parameters = {
        "protocol by distance": vars(study.distance),
        "bootstrap": vars(study.bootstrap),
        "budget": study.settings.budget,
    }
    sources = [study.source("evaluate", r.sequence, r.model) for r in study.results]
    yield section_of(
        study, "answer", values, findings=[findings.answer(study), *findings.caveats(study)]
    )
    yield section_of(
        study,
        "setup",
        values,
        tables=[tables.setup(study), tables.sequences(study), tables.costs(study)],
        sources=[study.source("train", model=model) for model in study.families],
        parameters=parameters,
    )
    for protocol in DISTANCE_FIRST:
        yield section_of(
            study,
            "results",
            values | {"protocol": protocol},
            name=f"results-{protocol}",
            tables=[tables.main_number(study, protocol, number) for number in MAIN_NUMBERS],
            sources=sources,
            parameters=parameters,
        )
    yield section_of(
        study,
        "further",
        values,
        findings=[
            *(finding for by in DISTANCE_FIRST for finding in findings.paired(study.rows, by)),
            *(finding for by in DISTANCE_FIRST for finding in findings.novelties(study, by)),
        ],
        tables=[
            tables.means(study),
            tables.headings(study),
            *(tested for by in DISTANCE_FIRST for tested in tables.paired(study, by)),
            *(tables.novelties(study, protocol) for protocol in DISTANCE_FIRST),
            *(tables.everything(study, protocol) for protocol in DISTANCE_FIRST),
        ],
        sources=sources,
    )
    yield section_of(
        study,
        "figures",
        values,
        illustrations=[
            replace(illustration, on_page=_is_on_page(illustration, study.best))
            for illustration in _illustrations(study, folder, view)
            if illustration
        ],
        sources=sources,
    )
    yield _ageing(study, folder, sources)
    if posed := [result for result in study.results if result.posed]:
        yield section_of(
            study,
            "poses",
            illustrations=_of_poses(study, folder, posed),
            tables=tables.pose_tables(posed),
            sources=[study.source("evaluate", r.sequence, r.model) for r in posed],
        )


def _is_on_page(illustration: Illustration, best: str) -> bool:
    """Whether the page shows a figure: of all models, or of the best one."""
    return illustration.kind in ON_PAGE and illustration.values.get("model", best) == best


def _illustrations(
    study: StudyResults, folder: Path, view: Callable[[str], Any]
) -> Iterator[Illustration | None]:
    """Draw every figure of the year."""
    draw = partial(illustrate, study, folder)
    results = study.results
    path_xy_m = study.train_xy_m
    yield draw("year", curves.year(results, study.train))
    yield draw("year_auc", curves.year(results, study.train, curves.FIGURE_8))
    for by in DISTANCE_FIRST:
        figure = curves.precision_recall(results, by)
        yield draw("precision_recall", figure, name=f"precision_recall_{by}", protocol=by)
    yield draw("recall_at", curves.recall_at(results))
    yield draw("place", _place(study, view))
    yield draw("montage", maps.montage(results, path_xy_m), name="outcomes")
    for model, group in by_model(results).items():
        novelty = group[0].evaluation.kinds[0].replace("_", " ")
        for kind, of_model in (
            ("novelty", rejection.histograms(group, "cells")),
            ("rejection", rejection.rejection(group)),
            ("reliability", rejection.diagram(group)),
            ("matches", _matches(study, model, matches.choose(group))),
        ):
            yield draw(kind, of_model, name=f"{kind}_{model}", model=model, novelty=novelty)
        for result in group:
            yield draw(
                "map",
                maps.outcome_map(result, path_xy_m),
                name=f"outcomes_{model}_{result.sequence}",
                model=model,
                sequence=result.sequence,
                label=result.label,
            )
        if model in study.trained and (record := study.models[model]).curves:
            figure = curves.history(record.curves, record.best_round, model)
            yield draw("history", figure, name=f"history_{model}", model=model)


def _place(study: StudyResults, view: Callable[[str], Any]) -> Figure | None:
    """The middle submap of training unperturbed and with two new walls, and its Scan Contexts.

    None if no method looks at Scan Contexts, or the scans are not here.
    """
    if not study.find("scans", study.train).is_dir():
        return None
    names = dict.fromkeys(name for method in study.settings.methods for name in method.views)
    scan_contexts = [drawn for drawn in map(view, names) if isinstance(drawn, ScanContext)]
    if not scan_contexts:
        return None
    submaps = study.artifact(Submaps, "submaps", study.train)
    middle = int(submaps["scans"].shape[0]) // 2
    scans = study.artifact(Scans, "scans", study.train)
    (points_m,) = submap_points(scans, submaps, slice(middle, middle + 1))
    two_walls = Construction(walls=(2,), shadows=(False,))
    clouds_m = views.perturbed(points_m, two_walls, int(submaps["stamps_ns"][middle]))
    return views.place(clouds_m, scan_contexts[0])


def _matches(study: StudyResults, model: str, chosen: list[matches.Example]) -> Figure | None:
    """Queries beside their matches, drawn as Scan Contexts.

    The views are the model's own, or else another model's. None if no model looks at any, or no
    examples were chosen.
    """

    def views_of(sequence: str, of_model: str) -> Views:
        return store.read(study.find("views", sequence, of_model), *VIEW_KINDS)

    with_scan_contexts = [
        candidate
        for candidate in (model, *study.families)
        if isinstance(views_of(study.train, candidate), ScanContextViews)
    ]
    if not chosen or not with_scan_contexts:
        return None

    def images(sequence: str) -> Any:
        return views_of(sequence, with_scan_contexts[0])["images"]

    training = matches.TrainingViews(
        images(study.train), study.labels.load("places"), study.train_xy_m
    )
    return matches.matches(chosen, training, images, own_views=with_scan_contexts[0] == model)


def _ageing(study: StudyResults, folder: Path, sources: list[str]) -> Section:
    """Whether methods recognise their places less well with the days, and when to train again."""
    rows = pick(study.unperturbed, variant="")
    last_day = max(result.days for result in study.results)
    followed = [
        ageing.FollowedNumber(protocol, number, LINES[number].format(protocol))
        for protocol, number in AGEING
    ]
    first, second, third = (
        findings.ageing(rows, line.title, line.protocol, line.number, last_day)
        for line in followed[:3]
    )
    drawn = followed[:DRAWN]
    counted = findings.slopes_counted(rows, AGEING[:DRAWN])
    draw = partial(illustrate, study, folder)
    return section_of(
        study,
        "ageing",
        {"last": last_day},
        findings=(first, second, findings.confounders(study)),
        illustrations=[
            draw(
                "ageing",
                ageing.lines(rows, drawn),
                third,
                findings.newer(rows),
                per=str(PER_DAYS),
            ),
            draw("ageing_slopes", ageing.slopes(rows, drawn), counted),
        ],
        tables=[tables.ageing(rows, line.protocol, line.number, line.title) for line in followed],
        sources=sources,
    )


def _of_poses(
    study: StudyResults, folder: Path, posed: Sequence[Result]
) -> Iterator[Illustration | None]:
    """The figures of models with poses: how near they are, and what their verdicts are worth."""
    draw = partial(illustrate, study, folder)
    for model, group in by_model(posed).items():
        for kind, figure in (
            ("verdicts", verdicts.verdicts(group)),
            ("probabilities", verdicts.probabilities(group)),
            ("failures", verdicts.cards(study, group)),
        ):
            yield draw(kind, figure, name=f"{kind}_{model}", model=model)
        yield draw(
            "fixes",
            maps.fix_map(group[-1], study.train_xy_m),
            name=f"fixes_{model}",
            model=model,
            sequence=group[-1].sequence,
            label=group[-1].label,
        )
