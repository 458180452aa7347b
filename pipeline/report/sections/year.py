"""The sections of every study of the year: the answer, the set-up, the results by both protocols,
all figures, ageing."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.evaluation.study_rows import AGEING, PER_DAYS
from pipeline.report import findings, tables
from pipeline.report.figures import ageing, curves, maps, matches, rejection
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.result import NONE, by_model
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study, indexed
from pipeline.schemas import VIEWS

# kinds of figure that the page shows; of those of one model, the best one's
ON_PAGE = (
    "year",
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


def sections(study: Study, folder: Path) -> Iterator[Section]:
    """Draw every figure into `folder` and yield the sections in the report's order."""
    name = anchor(study.name, study.grid)
    values = {
        "study": study,
        "tests": len(study.words["tests"]),
        "places": int(study.labels["cells"].shape[0]),
    }
    rests = {
        "protocol by distance": vars(study.distance),
        "bootstrap": vars(study.bootstrap),
        "budget": study.words["budget"],
    }
    trained = [study.source("train", model=model) for model in study.families]
    judged = [study.source("evaluate", one.sequence, one.model) for one in study.results]
    yield Section(
        f"{name}-answer",
        "answer",
        "answer",
        values,
        [findings.answer(study), *findings.doubts(study)],
    )
    unfolded: Any = {"folded": False, "parameters": rests}
    setup = [
        one for one in (tables.setup(study), tables.sequences(study), tables.costs(study)) if one
    ]
    yield Section(
        f"{name}-setup", "setup", "setup", values, tables=setup, sources=trained, **unfolded
    )
    for by in tables.BOTH:
        main = [tables.main(study, by, number) for number in tables.MAIN]
        yield Section(
            f"{name}-results-{by}",
            "results",
            "results",
            {**values, "protocol": by},
            tables=main,
            sources=judged,
            **unfolded,
        )
    further = [
        tables.means(study),
        tables.headings(study),
        *(tables.paired(study, by) for by in tables.BOTH),
    ]
    further += [
        one(study, by) for one in (tables.novelties, tables.everything) for by in tables.BOTH
    ]
    found = [one for by in tables.BOTH for one in findings.paired(study.rows, by)]
    found += [one for by in tables.BOTH for one in findings.novelties(study, by)]
    compared = [one for one in further if one]
    yield Section(
        f"{name}-further", "further", "results", values, found, tables=compared, sources=judged
    )
    drawn = [
        replace(
            one, on_page=one.kind in ON_PAGE and one.values.get("model", study.best) == study.best
        )
        for one in illustrations(study, folder)
    ]
    yield Section(
        f"{name}-figures", "figures", "figures", values, illustrations=drawn, sources=judged
    )
    yield aged(study, folder, judged)


def illustrations(study: Study, folder: Path) -> Iterator[Illustration]:
    """Every figure of the year, drawn."""

    def saved(
        kind: str, figure: Figure | None, name: str = "", **values: str
    ) -> Iterator[Illustration]:
        if figure:
            yield illustrate(kind, figure, study, folder, name=name, **values)

    results = study.results
    path_xy_m = study.train_xy_m
    yield from saved("year", curves.year(results, study.train))
    for by in tables.BOTH:
        yield from saved(
            "precision_recall",
            curves.precision_recall(results, by),
            f"precision_recall_{by}",
            protocol=by,
        )
    yield from saved("recall_at", curves.recall_at(results))
    yield from saved("montage", maps.montage(results, path_xy_m), "outcomes")
    for model, group in by_model(results).items():
        own = {"model": model, "novelty": group[0].evaluation.kinds[0].replace("_", " ")}
        yield from saved("novelty", rejection.histograms(group, "cells"), f"novelty_{model}", **own)
        yield from saved("rejection", rejection.rejection(group), f"rejection_{model}", **own)
        yield from saved("reliability", rejection.diagram(group), f"reliability_{model}", **own)
        yield from saved(
            "matches", _matches(study, model, matches.choose(group)), f"matches_{model}", **own
        )
        for one in group:
            of = {"model": model, "sequence": one.sequence, "label": one.label}
            yield from saved(
                "map", maps.outcome_map(one, path_xy_m), f"outcomes_{model}_{one.sequence}", **of
            )
        if model in study.trained and (learned := study.models[model]).curves:
            figure = curves.history(learned.curves, learned.best_round, model)
            yield from saved("history", figure, f"history_{model}", model=model)


def _matches(study: Study, model: str, chosen: list[matches.Example]) -> Figure | None:
    """Of the model's own Scan Contexts, else of another model's; None where no model of the study
    looks at any."""
    looking = [
        one
        for one in (model, *study.families)
        if study.artifact("views", study.train, one).attrs["kind"] == VIEWS.kind
    ]
    if not chosen or not looking:
        return None

    def images(sequence: str) -> Any:
        return study.artifact("views", sequence, looking[0])["images"]

    training = matches.Training(images(study.train), study.labels.load("places"), study.train_xy_m)
    return matches.matches(chosen, training, images, own=looking[0] == model)


def aged(study: Study, folder: Path, sources: list[str]) -> Section:
    """Whether methods know their places less well as the days go by, and when to train again."""
    rows = study.driven[study.driven["variant"] == ""]
    last = max(one.days for one in study.results)
    titled = [(by, number, LINES[number].format(by)) for by, number in AGEING]
    lines = [
        line for by, number, title in titled[:DRAWN] for line in _lines(rows, by, number, title)
    ]
    first, second, third = (
        findings.ageing(rows, title, by, number, last) for by, number, title in titled[:3]
    )
    counted = findings.slopes_counted(rows, [(by, number) for by, number, _ in titled[:DRAWN]])
    return Section(
        anchor(study.name, study.grid, "ageing"),
        "ageing",
        values={"study": study, "last": last},
        findings=(first, second, findings.confounders(study)),
        illustrations=[
            illustrate(
                "ageing",
                ageing.lines(lines),
                study,
                folder,
                third,
                findings.newer(rows),
                per=str(PER_DAYS),
            ),
            illustrate("ageing_slopes", ageing.slopes(lines), study, folder, counted),
        ],
        tables=[tables.ageing(rows, by, number, title) for by, number, title in titled],
        sources=sources,
    )


def _lines(
    rows: pd.DataFrame, protocol: str, number: str, title: str
) -> Iterator[ageing.AgeingLine]:
    """The line through one number of each model and the oracle, as the figure takes it."""
    own = rows[rows["protocol"] == protocol].sort_values("days")
    points, lines = (
        indexed(own[own["number"] == name], "method", "sequence", "days")
        for name in (number, f"{number}_line")
    )
    slopes = indexed(own[own["number"] == f"{number}_per_{PER_DAYS}_days"], "method")
    for model in dict.fromkeys(
        rows.loc[(rows["protocol"] == protocol) & (rows["number"] == f"{number}_line"), "method"]
    ):
        keys = [key for key in lines if key[0] == model]
        values, fitted = (
            np.array([of[key] for key in keys]).reshape(-1, 3) for of in (points, lines)
        )
        days = np.array([day for *_, day in keys])
        slope = np.array(slopes.get(model, NONE))
        yield ageing.AgeingLine(
            model, title, number == "novelty_percentile", days, values, fitted, slope
        )
