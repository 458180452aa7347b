"""The sections of every study of the year: the answer, the set-up, the results by both protocols, all figures, ageing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import AGEING, PER_DAYS
from pipeline.report import findings, tables
from pipeline.report.figures import ageing, curves, examples, maps, matches, novelty, rejection, reliability, year
from pipeline.report.figures.style import save
from pipeline.report.render import anchor
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study, by_model
from pipeline.schemas import VIEWS

ON_PAGE = ("year", "precision_recall", "recall_at", "montage", "novelty", "rejection", "reliability", "matches")
"""Kinds of figure that the page shows; of those of one model, the best one's."""
LINES = {
    "recall_at_1_same_heading": "recall@1, training's heading, by {}", "auc_top1": "AUC top-1, by {}", "auroc": "AUROC, by {}",
    "novelty_percentile": "novelty of the seen, percentile, by {}", "recall_at_1": "recall@1, by {}",
}  # fmt: skip
DRAWN = 4
"""Of the numbers that are followed over the days, the first so many are drawn."""


def sections(study: Study, folder: Path) -> Iterator[Section]:
    """Draw every figure into `folder` and yield the sections in the report's order."""
    name = anchor(study.name, study.grid)
    values = {"study": study, "tests": len(study.words["tests"]), "places": int(study.labels["cells"].shape[0])}
    rests = {"protocol by distance": vars(study.distance), "bootstrap": vars(study.bootstrap), "budget": study.words["budget"]}
    trained = tuple(study.source("train", model=model) for model in study.families)
    judged = tuple(study.source("evaluate", one.sequence, one.model) for one in study.results)
    yield Section(f"{name}-answer", "answer", "answer", values, (findings.answer(study),))
    setup = tuple(one for one in (tables.setup(study), tables.sequences(study), tables.costs(study)) if one)
    yield Section(f"{name}-setup", "setup", "setup", values, tables=setup, folded=False, sources=trained, parameters=rests)
    for by in reversed(PROTOCOLS):
        main = tuple(tables.main(study, by, number) for number in tables.MAIN)
        own = {**values, "protocol": by}
        yield Section(
            f"{name}-results-{by}", "results", "results", own, tables=main, folded=False, sources=judged, parameters=rests
        )
    further = [tables.means(study), tables.headings(study), *(tables.paired(study, by) for by in PROTOCOLS)]
    tested = tuple(one for by in PROTOCOLS for one in findings.paired(study.rows, by))
    kinds = [tables.novelties(study, by) for by in PROTOCOLS] + [tables.everything(study, by) for by in PROTOCOLS]
    found = tuple(one for by in PROTOCOLS for one in findings.novelties(study, by))
    compared = tuple(one for one in (*further, *kinds) if one)
    yield Section(f"{name}-further", "further", "results", values, (*tested, *found), tables=compared, sources=judged)
    drawn = tuple(illustrations(study, folder))
    yield Section(f"{name}-figures", "figures", "figures", values, illustrations=drawn, sources=judged)
    yield aged(study, folder, judged)


def illustrations(study: Study, folder: Path) -> Iterator[Illustration]:
    """Every figure of the year, drawn."""

    def saved(kind: str, name: str, figure: Figure | None, **values: str) -> Iterator[Illustration]:
        if figure:
            on_page = kind in ON_PAGE and values.get("model", study.best) == study.best
            yield Illustration(
                kind, save(figure, folder / f"{name}.svg"), {"model": "", "sequence": "", **values}, on_page=on_page
            )

    results, simulated = study.results, study.simulated
    yield from saved("year", "year", year.year(results, study.train, simulated))
    for by in PROTOCOLS:
        figure = curves.precision_recall(results, by, simulated)
        yield from saved("precision_recall", f"precision_recall_{by}", figure, protocol=by)
    yield from saved("recall_at", "recall_at", curves.recall_at(results, simulated))
    yield from saved("montage", "outcomes", maps.montage(results, study.train_xy_m, simulated))
    for model, group in by_model(results).items():
        own = {"model": model, "novelty": group[0].evaluation.kinds[0].replace("_", " ")}
        yield from saved("novelty", f"novelty_{model}", novelty.histograms(group, "cells", simulated), **own)
        yield from saved("rejection", f"rejection_{model}", rejection.rejection(group, simulated), **own)
        yield from saved("reliability", f"reliability_{model}", reliability.diagram(group, simulated), **own)
        yield from saved("matches", f"matches_{model}", _matches(study, model, examples.choose(group)), **own)
        for one in group:
            figure, own = maps.outcome_map(one, study.train_xy_m, simulated), {"model": model, "sequence": one.sequence}
            yield from saved("map", f"outcomes_{model}_{one.sequence}", figure, **own, label=one.label)
        if (learned := study.models[model]).curves:
            figure = curves.history(learned.curves, learned.best_round, model, simulated)
            yield from saved("history", f"history_{model}", figure, model=model)


def _matches(study: Study, model: str, chosen: list[examples.Example]) -> Figure | None:
    """Of the model's own Scan Contexts, else of another model's; None where no model of the study looks at any."""
    looking = [one for one in (model, *study.families) if study.artifact("views", study.train, one).attrs["kind"] == VIEWS.kind]
    if not chosen or not looking:
        return None

    def images(sequence: str) -> Any:
        return study.artifact("views", sequence, looking[0])["images"]

    training = matches.Training(images(study.train), study.labels.load("places"), study.train_xy_m)
    return matches.matches(chosen, training, images, study.simulated, own=looking[0] == model)


def aged(study: Study, folder: Path, sources: tuple[str, ...]) -> Section:
    """Whether methods know their places less well as the days go by, and when to train again."""
    rows = study.rows[
        (study.rows["variant"] == "") & (study.rows["seed"] == 0) & (study.rows["change"] == "") & (study.rows["kind"] == "")
    ]
    titled = [(by, number, LINES[number].format(by)) for by, number in AGEING]
    last = max(one.days for one in study.results)
    lines = [line for by, number, title in titled[:DRAWN] for line in _lines(rows, by, number, title)]
    save(ageing.lines(lines, study.simulated), folder / "ageing.svg")
    save(ageing.slopes(lines, study.simulated), folder / "ageing_slopes.svg")
    verdicts = [findings.ageing(rows, title, by, number, last) for by, number, title in titled[:3]]
    drawn = [(by, number) for by, number, _ in titled[:DRAWN]]
    shown = (
        Illustration("ageing", folder / "ageing.svg", {"per": PER_DAYS}, (verdicts[2], findings.newer(rows))),
        Illustration("ageing_slopes", folder / "ageing_slopes.svg", {}, (findings.slopes_counted(rows, drawn),)),
    )
    told = (*verdicts[:2], findings.confounders(study))
    listed = tuple(tables.ageing(rows, by, number, title) for by, number, title in titled)
    name, values = anchor(study.name, study.grid, "ageing"), {"study": study, "last": last}
    return Section(name, "ageing", "studies", values, told, shown, listed, sources=sources)


def _lines(rows: pd.DataFrame, protocol: str, number: str, title: str) -> Iterator[ageing.AgeingLine]:
    """The line through one number of each model and the oracle, as the figure takes it."""
    own = rows[rows["protocol"] == protocol]
    slopes = own[own["number"] == f"{number}_per_{PER_DAYS}_days"].set_index("method")[["value", "low", "high"]]
    for model in dict.fromkeys(own.loc[own["number"] == f"{number}_line", "method"]):
        of = own[own["method"] == model].sort_values("days")
        points, line = (of[of["number"] == name].drop_duplicates("sequence") for name in (number, f"{number}_line"))
        points = points[points["sequence"].isin(set(line["sequence"]))]
        slope = slopes.loc[model].to_numpy(float) if model in slopes.index else np.full(3, np.nan)
        columns = [one[["value", "low", "high"]].to_numpy(float) for one in (points, line)]
        days = line["days"].to_numpy(float)
        yield ageing.AgeingLine(model, title, number == "novelty_percentile", days, columns[0], columns[1], slope)
