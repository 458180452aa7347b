"""The sections of a study of the year: answer, set-up, results, figures and ageing."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pipeline.alterations.construction import Construction
from pipeline.core import store
from pipeline.core.schemas import VIEW_KINDS, ScanContextViews, Scans, Submaps, Views
from pipeline.evaluation.study_rows import AGEING, PER_DAYS
from pipeline.mapping.gathering import submap_points
from pipeline.report import findings, tables
from pipeline.report.figures import ageing, curves, maps, matches, place, rejection
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.result import by_model
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study
from pipeline.views.scan_context import ScanContext

# kinds of figure that the page shows; of those of one model, the best one's
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
LINES = {
    "recall_at_1_same_heading": "recall@1, training's heading, by {}",
    "auc_top1": "AUC top-1, by {}",
    "auroc": "AUROC, by {}",
    "novelty_percentile": "novelty of the seen, percentile, by {}",
    "recall_at_1": "recall@1, by {}",
}
DRAWN = 4  # so many of the numbers that are followed over the days are drawn, the first ones


def sections(study: Study, folder: Path, view: Callable[[str], Any]) -> Iterator[Section]:
    """Draw every figure into `folder` and yield the sections in the report's order.

    `view` makes a view of its name.
    """
    name = anchor(study.name, study.grid)
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
    model_sources = [study.source("train", model=model) for model in study.families]
    evaluation_sources = [
        study.source("evaluate", result.sequence, result.model) for result in study.results
    ]
    yield Section(
        f"{name}-answer",
        "answer",
        "answer",
        values,
        [findings.answer(study), *findings.doubts(study)],
    )
    unfolded: Any = {"folded": False, "parameters": parameters}
    setup = [
        table
        for table in (tables.setup(study), tables.sequences(study), tables.costs(study))
        if table
    ]
    yield Section(
        f"{name}-setup", "setup", "setup", values, tables=setup, sources=model_sources, **unfolded
    )
    for protocol in tables.BOTH:
        main_tables = [tables.main(study, protocol, number) for number in tables.MAIN]
        yield Section(
            f"{name}-results-{protocol}",
            "results",
            "results",
            {**values, "protocol": protocol},
            tables=main_tables,
            sources=evaluation_sources,
            **unfolded,
        )
    further = [
        tables.means(study),
        tables.headings(study),
        *(tables.paired(study, protocol) for protocol in tables.BOTH),
    ]
    further += [
        make_table(study, protocol)
        for make_table in (tables.novelties, tables.everything)
        for protocol in tables.BOTH
    ]
    further_findings = [
        finding for protocol in tables.BOTH for finding in findings.paired(study.rows, protocol)
    ]
    further_findings += [
        finding for protocol in tables.BOTH for finding in findings.novelties(study, protocol)
    ]
    present_tables = [table for table in further if table]
    yield Section(
        f"{name}-further",
        "further",
        "results",
        values,
        further_findings,
        tables=present_tables,
        sources=evaluation_sources,
    )
    figures = [
        replace(
            illustration,
            on_page=illustration.kind in ON_PAGE
            and illustration.values.get("model", study.best) == study.best,
        )
        for illustration in illustrations(study, folder, view)
    ]
    yield Section(
        f"{name}-figures",
        "figures",
        "figures",
        values,
        illustrations=figures,
        sources=evaluation_sources,
    )
    yield ageing_section(study, folder, evaluation_sources)


def illustrations(study: Study, folder: Path, view: Callable[[str], Any]) -> Iterator[Illustration]:
    """Draw every figure of the year."""

    def saved(
        kind: str, figure: Figure | None, name: str = "", **values: str
    ) -> Iterator[Illustration]:
        if figure:
            yield illustrate(kind, figure, study, folder, name=name, **values)

    results = study.results
    path_xy_m = study.train_xy_m
    yield from saved("year", curves.year(results, study.train))
    yield from saved("year_auc", curves.year(results, study.train, curves.FIGURE_8))
    for protocol in tables.BOTH:
        yield from saved(
            "precision_recall",
            curves.precision_recall(results, protocol),
            f"precision_recall_{protocol}",
            protocol=protocol,
        )
    yield from saved("recall_at", curves.recall_at(results))
    yield from saved("place", _place(study, view))
    yield from saved("montage", maps.montage(results, path_xy_m), "outcomes")
    for model, group in by_model(results).items():
        model_words = {"model": model, "novelty": group[0].evaluation.kinds[0].replace("_", " ")}
        yield from saved(
            "novelty", rejection.histograms(group, "cells"), f"novelty_{model}", **model_words
        )
        yield from saved(
            "rejection", rejection.rejection(group), f"rejection_{model}", **model_words
        )
        yield from saved(
            "reliability", rejection.diagram(group), f"reliability_{model}", **model_words
        )
        yield from saved(
            "matches",
            _matches(study, model, matches.choose(group)),
            f"matches_{model}",
            **model_words,
        )
        for result in group:
            result_words = {"model": model, "sequence": result.sequence, "label": result.label}
            yield from saved(
                "map",
                maps.outcome_map(result, path_xy_m),
                f"outcomes_{model}_{result.sequence}",
                **result_words,
            )
        if model in study.trained and (record := study.models[model]).curves:
            figure = curves.history(record.curves, record.best_round, model)
            yield from saved("history", figure, f"history_{model}", model=model)


def _views(study: Study, sequence: str, model: str) -> Views:
    """The views of a sequence that a model looks at."""
    return store.read(study.find("views", sequence, model), *VIEW_KINDS)


def _place(study: Study, view: Callable[[str], Any]) -> Figure | None:
    """The middle submap of training as driven and with two new walls, and its Scan Contexts.

    None where no method looks at any, or the scans are not here.
    """
    if not study.find("scans", study.train).is_dir():
        return None
    views = {name: view(name) for method in study.settings.methods for name in method.views}
    scan_contexts = [drawn for drawn in views.values() if isinstance(drawn, ScanContext)]
    if not scan_contexts:
        return None
    scans = study.artifact(Scans, "scans", study.train)
    submaps = study.artifact(Submaps, "submaps", study.train)
    middle = int(submaps["scans"].shape[0]) // 2
    (points_m,) = submap_points(scans, submaps, slice(middle, middle + 1))
    stamp_ns = int(submaps["stamps_ns"][middle])
    two_walls = Construction(walls=(2,), shadows=(False,))
    return place.place(place.altered(points_m, two_walls, stamp_ns), scan_contexts[0])


def _matches(study: Study, model: str, chosen: list[matches.Example]) -> Figure | None:
    """Queries beside their matches, drawn as Scan Contexts.

    The views are the model's own, or else another model's; None where no model looks at any.
    """
    with_scan_contexts = [
        candidate
        for candidate in (model, *study.families)
        if isinstance(_views(study, study.train, candidate), ScanContextViews)
    ]
    if not chosen or not with_scan_contexts:
        return None

    def images(sequence: str) -> Any:
        return _views(study, sequence, with_scan_contexts[0])["images"]

    training = matches.Training(images(study.train), study.labels.load("places"), study.train_xy_m)
    return matches.matches(chosen, training, images, own_views=with_scan_contexts[0] == model)


def ageing_section(study: Study, folder: Path, sources: list[str]) -> Section:
    """Whether methods recognise their places less well with the days, and when to train again."""
    rows = study.driven[study.driven["variant"] == ""]
    last = max(result.days for result in study.results)
    titled_numbers = [
        (protocol, number, LINES[number].format(protocol)) for protocol, number in AGEING
    ]
    drawn = titled_numbers[:DRAWN]
    first, second, third = (
        findings.ageing(rows, title, protocol, number, last)
        for protocol, number, title in titled_numbers[:3]
    )
    slope_counts = findings.slopes_counted(
        rows, [(protocol, number) for protocol, number, _ in drawn]
    )
    return Section(
        anchor(study.name, study.grid, "ageing"),
        "ageing",
        values={"study": study, "last": last},
        findings=(first, second, findings.confounders(study)),
        illustrations=[
            illustrate(
                "ageing",
                ageing.lines(rows, drawn),
                study,
                folder,
                third,
                findings.newer(rows),
                per=str(PER_DAYS),
            ),
            illustrate("ageing_slopes", ageing.slopes(rows, drawn), study, folder, slope_counts),
        ],
        tables=[
            tables.ageing(rows, protocol, number, title)
            for protocol, number, title in titled_numbers
        ],
        sources=sources,
    )
