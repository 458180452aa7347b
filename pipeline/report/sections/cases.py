"""The sections of a study of robustness: turned queries, demolition, construction, stress, real changes, cell sizes."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.evaluation.events import Bands
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import SHOWN, TO_COME
from pipeline.report import case_findings as verdicts
from pipeline.report import case_tables, findings, tables
from pipeline.report.comparison import AUC, FAR, KEPT, OFF, RECALL, Comparison, Kind
from pipeline.report.figures import cells, events, levels, robustness
from pipeline.report.figures.style import save
from pipeline.report.render import anchor
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study, by_model

UNITS = {"demolition": "degrees removed", "construction": "new walls"}
PANELS = (("cells", "auc_top1"), ("cells", "recall_at_1"), ("distance", "auc_top1"), ("distance", "recall_at_1"))
NEAR = ("recall_at_1", "auc_exact_top1")
TITLES = {"auc_top1": "AUC top-1", "recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}


def sections(study: Study, folder: Path, bands: Bands) -> Iterator[Section]:
    """Draw the figures into `folder` and yield what the study has."""
    own = study.rows[(study.rows["kind"] == "") & (study.rows["sequence"] != "")]
    for alteration, sequences in study.words.get("altered", {}).items():
        changes = _changes(alteration)
        some = own[own["sequence"].isin(sequences) & own["change"].isin(["", *changes])]
        answered = some[some["change"] != ""][["method", "variant", "seed"]].drop_duplicates()
        comparison = Comparison(some.merge(answered), _n_way(study))
        if alteration in UNITS:
            yield _structure(study, folder, alteration, comparison)
        elif alteration == "turned":
            yield _turned(study, folder, comparison)
        else:
            yield _glance(study, folder, alteration, comparison)
    if stress := study.words.get("stress", {}):
        yield _stress(study, folder, Comparison(own[own["sequence"].isin(stress) & (own["change"] == "")], _n_way(study)), stress)
    if study.words["question"] == "robustness":
        yield _events(study, folder, bands)
    if study.words.get("cells"):
        yield _cells(study, folder)


def _changes(alteration: str) -> tuple[str, ...]:
    """The changes that an alteration's cases have; one that is no change itself has several."""
    known = ("turned", "demolition", "construction")
    return (alteration,) if alteration in known else known


def _n_way(study: Study) -> dict[str, int]:
    """The N of N-way training of each model whose recipe has one."""
    recipes = {name: study.recipe(name) for name in study.trained}
    return {name: int(recipe["n_way"]) for name, recipe in recipes.items() if "n_way" in recipe}


def _section(study: Study, kind: str, comparison: Comparison, found: Any, shown: Any, listed: Any, name: str = "") -> Section:
    scope = findings.scope(study, study.grid, len(comparison.sequences), max(comparison.seeds.values()), comparison.repeats)
    anchored = anchor(study.name, study.grid, name or kind)
    parameters = {"budget": study.words["budget"], "train": study.train, "sequences": comparison.sequences}
    sources = tuple(f"{study.artifacts.name}/evaluate/{study.name}/{study.grid}/{model}" for model in study.trained)
    return Section(anchored, kind, "studies", {"study": study}, (*found, scope), shown, tuple(listed), True, sources, parameters)


def _both(comparison: Comparison) -> list[Any]:
    return [case_tables.every_case(comparison, measures) for measures in (case_tables.BY_CELLS, case_tables.BY_DISTANCE)]


def _turned(study: Study, folder: Path, comparison: Comparison) -> Section:
    """Fig. 10: queries that are turned by random angles."""
    kind, where = comparison.kinds[-1], study.name
    tells = any(np.isfinite(comparison.found(model, kind, OFF).mean) for model in comparison.models)
    measures = (AUC, KEPT, FAR, OFF) if tells else (AUC, KEPT, FAR)
    figure = robustness.dots(comparison, measures, kind, study.simulated, f"Queries turned by random angles, {where}")
    about = (verdicts.kept, verdicts.nearly_always, verdicts.heading_errors, verdicts.chance)
    shown = [Illustration("turned", save(figure, folder / "turned.svg"), {}, tuple(one(comparison, kind) for one in about))]
    if len(ways := comparison.ways()) > 1:
        others = [one for one in comparison.ordered(kind, AUC) if one not in ways.values()][:2]
        figure = levels.ways(comparison, kind, others, study.simulated, f"N-way training, {where}")
        shown.append(Illustration("ways", save(figure, folder / "ways.svg"), {}))
    found = (verdicts.leader(comparison, kind, AUC), verdicts.n_ways(comparison, kind))
    listed = [*_both(comparison), case_tables.on_sequences(comparison, kind, AUC)]
    return _section(study, "turned", comparison, found, tuple(shown), listed)


def _structure(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """Fig. 9: a wedge of directions gone, or new walls."""
    worst = max(comparison.changes, key=lambda kind: (kind.level, kind.shadow))
    figure = levels.levels(comparison, study.simulated, f"{alteration.capitalize()}, {study.name}", UNITS[alteration])
    about = (verdicts.kept(comparison, worst), *verdicts.shadows(comparison), verdicts.nearly_always(comparison, worst))
    about = (*about, verdicts.chance(comparison, worst))
    shown = (Illustration("structure", save(figure, folder / f"{alteration}.svg"), {"alteration": alteration}, about),)
    found = (verdicts.leader(comparison, worst, AUC), verdicts.leader(comparison, worst, KEPT))
    listed = [*(case_tables.over_kinds(comparison, one) for one in (AUC, KEPT, FAR)), *_both(comparison)]
    return _section(study, alteration, comparison, found, shown, listed)


def _glance(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """A case or two of several alterations side by side."""
    figure = robustness.dots(comparison, (AUC, KEPT, FAR), Kind(), study.simulated, f"Altered queries at a glance, {study.name}")
    about = tuple(verdicts.kept(comparison, kind) for kind in comparison.changes)
    shown = (Illustration("glance", save(figure, folder / f"{alteration}.svg"), {}, about),)
    found = tuple(verdicts.leader(comparison, kind, AUC) for kind in comparison.kinds)
    return _section(study, "glance", comparison, found, shown, _both(comparison), alteration)


def _stress(study: Study, folder: Path, comparison: Comparison, stress: Mapping[str, str]) -> Section:
    """Sequences that are hard as they are."""
    named = {one: f"{one[:10]}, {stress[one]}" for one in comparison.sequences}
    figure = robustness.sequences(comparison, named, study.simulated, f"Sequences of stress, {study.name}")
    about = (verdicts.nearly_always(comparison, Kind()), verdicts.chance(comparison, Kind()))
    shown = (Illustration("stress", save(figure, folder / "stress.svg"), {}, about),)
    found = (verdicts.leader(comparison, Kind(), RECALL), verdicts.best_on_each(comparison, named))
    return _section(study, "stress", comparison, found, shown, [case_tables.stress(comparison, named)])


def _events(study: Study, folder: Path, bands: Bands) -> Section:
    """By the distance to the nearest building that went up or came down."""
    rows, names = study.rows, dict(zip((*bands.edges_m, np.inf), bands.names, strict=True))
    own = rows[rows["change"].isin([SHOWN, TO_COME])].set_index(["method", "protocol", "change", "number"]).sort_index()
    values = {}
    for model in by_model(study.results):
        if model not in own.index.get_level_values(0):
            continue
        for by in PROTOCOLS:
            for when in (SHOWN, TO_COME):
                group = own.loc[(model, by, when)]
                counts = [group.loc[[name]].sort_values("level")["value"].to_numpy(int) for name in ("seen", "unseen")]
                shares = [group.loc[[name]].sort_values("level")[["value", "low", "high"]].to_numpy(float) for name in NEAR]
                values[model, by, when == SHOWN] = events.BandValues(*counts, *shares)
    figure = events.by_distance(values, bands.names, bands.few, study.simulated)
    about = (findings.near_changes(rows, "auc_exact_top1", names, bands.few),)
    shown = (Illustration("events", save(figure, folder / "events.svg"), {}, about),)
    counted = findings.changes_counted(rows, bands.kinds, bands.edges_m[-1])
    found = (findings.near_changes(rows, "recall_at_1", names, bands.few), counted)
    listed = tuple(tables.near_changes(rows, by, number, names) for by in PROTOCOLS for number in NEAR)
    name, sources = anchor(study.name, study.grid, "events"), (f"{study.artifacts.name}/events/{study.name}",)
    parameters = {"edges_m": list(bands.edges_m), "kinds": list(bands.kinds), "few": bands.few}
    return Section(name, "events", "studies", {"study": study}, found, shown, listed, True, sources, parameters)


def _cells(study: Study, folder: Path) -> Section:
    """Fig. 11: what the side of a grid cell does to each method, which learns its places anew at every size."""
    driven = study.table[(study.table["change"] == "") & (study.table["kind"] == "") & (study.table["stress"] == "")]
    driven = driven[(driven["variant"] == "") & (driven["seed"] == 0) & (driven["sequence"] != "")]
    grids = sorted((*study.words["grids"], *study.words["cells"]), key=lambda grid: replace(study, grid=grid).cell_m)
    sizes_m, methods = [replace(study, grid=grid).cell_m for grid in grids], [method["name"] for method in study.words["methods"]]
    by = driven.set_index(["method", "protocol", "number", "grid"]).sort_index()["value"]

    def values(model: str, protocol: str, number: str) -> list[Any]:
        return [by.loc[[(model, protocol, number, grid)]].dropna().to_numpy(float) for grid in grids]

    every = {(model, *panel): values(model, *panel) for model in methods for panel in PANELS}
    oracle = {protocol: [float(np.mean(one)) for one in values(methods[0], protocol, "oracle")] for protocol in PROTOCOLS}
    figure = cells.cells(every, sizes_m, oracle, study.simulated, f"The side of a cell, {study.name}")
    of = {panel: {model: every[(model, *panel)] for model in methods} for panel in PANELS}
    titles = {panel: f"{TITLES[panel[1]]} by {panel[0]}" for panel in PANELS}
    about = tuple(findings.best_at_each_size(of[panel], titles[panel], sizes_m) for panel in PANELS)
    found = tuple(findings.trend(of[panel], titles[panel], sizes_m) for panel in (PANELS[0], PANELS[3]))
    listed = tuple(case_tables.cells(of[panel], titles[panel], sizes_m) for panel in PANELS)
    shown = (Illustration("cells", save(figure, folder / "cells.svg"), {}, about),)
    name = anchor(study.name, "cells")
    sources = tuple(f"{study.artifacts.name}/evaluate/{study.name}/{grid}" for grid in grids)
    return Section(name, "cells", "studies", {"study": study}, found, shown, listed, True, sources)
