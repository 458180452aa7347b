"""The sections of a study of robustness: turned queries, demolition, construction, stress, real
changes, cell sizes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.evaluation.events import Bands
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import SHOWN, TO_COME
from pipeline.report import case_findings as verdicts
from pipeline.report import case_tables, findings, tables
from pipeline.report.comparison import AUC, FAR, KEPT, OFF, RECALL, Comparison, Kind
from pipeline.report.figures import events, robustness
from pipeline.report.figures.style import illustrate
from pipeline.report.findings import Finding
from pipeline.report.render import anchor
from pipeline.report.result import day
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study, indexed
from pipeline.report.table import Table

UNITS = {"demolition": "degrees removed", "construction": "new walls"}
CHANGES = ("turned", *UNITS)
PANELS = (
    ("cells", "auc_top1"),
    ("cells", "recall_at_1"),
    ("distance", "auc_top1"),
    ("distance", "recall_at_1"),
)
NEAR = ("recall_at_1", "auc_exact_top1")


def sections(study: Study, folder: Path, few: int) -> Iterator[Section]:
    """Draw the figures into `folder` and yield what the study has."""
    own = study.rows[(study.rows["kind"] == "") & (study.rows["sequence"] != "")]
    recipes = {name: study.recipe(name) for name in study.trained}
    n_way = {name: int(recipe["n_way"]) for name, recipe in recipes.items() if "n_way" in recipe}
    for alteration, sequences in study.words.get("altered", {}).items():
        changes = (
            (alteration,) if alteration in CHANGES else CHANGES
        )  # one that is no change itself has several
        some = own[own["sequence"].isin(sequences) & own["change"].isin(["", *changes])]
        answered = some[some["change"] != ""][["method", "variant", "seed"]].drop_duplicates()
        write = (
            _structure if alteration in UNITS else _turned if alteration == "turned" else _glance
        )
        yield write(study, folder, alteration, Comparison(some.merge(answered), n_way))
    if stress := study.words.get("stress", {}):
        yield _stress(
            study,
            folder,
            Comparison(own[own["sequence"].isin(stress) & (own["change"] == "")], n_way),
            stress,
        )
    if study.words["question"] == "robustness":
        yield _events(study, folder, few)
    if study.words.get("cells"):
        yield _cells(study, folder)


def _section(
    study: Study,
    kind: str,
    comparison: Comparison,
    found: Sequence[Finding],
    shown: Sequence[Illustration],
    listed: Sequence[Table],
    name: str = "",
) -> Section:
    scope = findings.scope(
        study, len(comparison.sequences), max(comparison.seeds.values()), comparison.repeats
    )
    return Section(
        anchor(study.name, study.grid, name or kind),
        kind,
        values={"study": study},
        findings=(*found, scope),
        illustrations=shown,
        tables=listed,
        sources=[
            f"{study.artifacts.name}/evaluate/{study.name}/{study.grid}/{model}"
            for model in study.trained
        ],
        parameters={
            "budget": study.words["budget"],
            "train": study.train,
            "sequences": comparison.sequences,
        },
    )


def _both(comparison: Comparison) -> list[Table]:
    return [
        case_tables.every_case(comparison, measures)
        for measures in (case_tables.BY_CELLS, case_tables.BY_DISTANCE)
    ]


def _turned(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """Fig. 10: queries that are turned by random angles."""
    kind = comparison.kinds[-1]
    ways = comparison.ways()
    tells = any(np.isfinite(comparison.found(model, kind, OFF).mean) for model in comparison.models)
    measures = (AUC, KEPT, FAR, OFF) if tells else (AUC, KEPT, FAR)
    figure = robustness.dots(
        comparison, measures, kind, f"Queries turned by random angles, {study.name}"
    )
    about = (verdicts.kept, verdicts.nearly_always, verdicts.heading_errors, verdicts.chance)
    shown = [illustrate("turned", figure, study, folder, *(one(comparison, kind) for one in about))]
    if len(ways) > 1:
        others = [one for one in comparison.ordered(kind, AUC) if one not in ways.values()][:2]
        figure = robustness.ways(comparison, kind, others, f"N-way training, {study.name}")
        shown.append(illustrate("ways", figure, study, folder))
    found = (verdicts.leader(comparison, kind, AUC), verdicts.n_ways(comparison, kind))
    listed = [*_both(comparison), case_tables.on_sequences(comparison, kind, AUC)]
    return _section(study, alteration, comparison, found, shown, listed)


def _structure(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """Fig. 9: a wedge of directions gone, or new walls."""
    worst = max(comparison.changes, key=lambda kind: (kind.level, kind.shadow))
    figure = robustness.levels(
        comparison, f"{alteration.capitalize()}, {study.name}", UNITS[alteration]
    )
    about = (
        verdicts.kept(comparison, worst),
        *verdicts.shadows(comparison),
        verdicts.nearly_always(comparison, worst),
    )
    about = (*about, verdicts.chance(comparison, worst))
    shown = illustrate(
        "structure", figure, study, folder, *about, name=alteration, alteration=alteration
    )
    found = [verdicts.leader(comparison, worst, measure) for measure in (AUC, KEPT)]
    listed = [
        *(case_tables.over_kinds(comparison, one) for one in (AUC, KEPT, FAR)),
        *_both(comparison),
    ]
    return _section(study, alteration, comparison, found, [shown], listed)


def _glance(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """A case or two of several alterations side by side."""
    figure = robustness.dots(
        comparison, (AUC, KEPT, FAR), Kind(), f"Altered queries at a glance, {study.name}"
    )
    about = [verdicts.kept(comparison, kind) for kind in comparison.changes]
    shown = illustrate("glance", figure, study, folder, *about, name=alteration)
    found = [verdicts.leader(comparison, kind, AUC) for kind in comparison.kinds]
    return _section(study, "glance", comparison, found, [shown], _both(comparison), alteration)


def _stress(
    study: Study, folder: Path, comparison: Comparison, stress: Mapping[str, str]
) -> Section:
    """Sequences that are hard as they are."""
    named = {one: f"{day(one)}, {stress[one]}" for one in comparison.sequences}
    figure = robustness.sequences(comparison, named, f"Sequences of stress, {study.name}")
    about = (verdicts.nearly_always(comparison, Kind()), verdicts.chance(comparison, Kind()))
    found = (verdicts.leader(comparison, Kind(), RECALL), verdicts.best_on_each(comparison, named))
    shown = illustrate("stress", figure, study, folder, *about)
    return _section(
        study, "stress", comparison, found, [shown], [case_tables.stress(comparison, named)]
    )


def _events(study: Study, folder: Path, few: int) -> Section:
    """By the distance to the nearest building that went up or came down."""
    rows = study.rows
    bands = _bands(rows)
    names = dict(zip((*bands.edges_m, np.inf), bands.names, strict=True))
    values = {}
    known = indexed(rows, "change", "method", "protocol", "number", "level")
    models = [
        model for model in study.families if (SHOWN, model, PROTOCOLS[0], "seen", np.inf) in known
    ]
    for model, by, when in product(models, PROTOCOLS, (SHOWN, TO_COME)):
        found = {
            key: np.array([known[when, model, by, key, edge] for edge in names])
            for key in ("seen", "unseen", *NEAR)
        }
        values[model, by, when == SHOWN] = events.BandValues(
            found["seen"][:, 0], found["unseen"][:, 0], *(found[key] for key in NEAR)
        )
    figure = events.by_distance(values, bands.names, few)
    recall, auc = (findings.near_changes(rows, number, names, few) for number in NEAR)
    return Section(
        anchor(study.name, study.grid, "events"),
        "events",
        values={"study": study},
        findings=(recall, findings.changes_counted(rows, bands.kinds, bands.edges_m[-1])),
        illustrations=[illustrate("events", figure, study, folder, auc)],
        tables=[
            tables.near_changes(rows, by, number, names) for by in PROTOCOLS for number in NEAR
        ],
        sources=[f"{study.artifacts.name}/events/{study.name}"],
        parameters={"edges_m": list(bands.edges_m), "kinds": list(bands.kinds), "few": few},
    )


def _bands(rows: pd.DataFrame) -> Bands:
    """The bands of distance that the rows go by."""
    edges_m = sorted(
        edge for edge in rows.loc[rows["change"] == SHOWN, "level"].unique() if np.isfinite(edge)
    )
    ending = "_changes"
    counted = rows.loc[
        rows["number"].str.endswith(ending) & (rows["method"] == ""), "number"
    ].unique()
    return Bands(edges_m, [number.removesuffix(ending) for number in counted])


def _cells(study: Study, folder: Path) -> Section:
    """Fig. 11: what the side of a grid cell does to each method, which learns its places anew at
    every size."""
    sides_m = {
        grid: replace(study, grid=grid).cell_m
        for grid in (*study.words["grids"], *study.words["cells"])
    }
    grids = sorted(sides_m, key=lambda grid: sides_m[grid])
    methods = [method["name"] for method in study.words["methods"]]
    sizes_m = [sides_m[grid] for grid in grids]
    table = study.table
    driven = table[
        (table[["change", "kind", "stress", "variant"]] == "").all(axis=1)
        & (table["seed"] == 0)
        & (table["sequence"] != "")
    ]
    by = {
        key: group.dropna().to_numpy()
        for key, group in driven.groupby(["method", "protocol", "number", "grid"])["value"]
    }
    every = {
        (model, *panel): [by[model, *panel, grid] for grid in grids]
        for model in methods
        for panel in PANELS
    }
    oracle = {
        protocol: [by[methods[0], protocol, "oracle", grid].mean() for grid in grids]
        for protocol in PROTOCOLS
    }
    figure = robustness.cells(every, sizes_m, oracle, f"The side of a cell, {study.name}")
    titled = [
        (
            {model: every[model, *panel] for model in methods},
            f"{tables.TITLES[panel[1]]} by {panel[0]}",
        )
        for panel in PANELS
    ]
    about = [findings.best_at_each_size(*one, sizes_m) for one in titled]
    return Section(
        anchor(study.name, "cells"),
        "cells",
        values={"study": study},
        findings=[findings.trend(*one, sizes_m) for one in (titled[0], titled[3])],
        illustrations=[illustrate("cells", figure, study, folder, *about)],
        tables=[case_tables.cells(*one, sizes_m) for one in titled],
        sources=[f"{study.artifacts.name}/evaluate/{study.name}/{grid}" for grid in grids],
    )
