"""The sections of a study of robustness.

They are on turned queries, demolition, construction, stress, real changes and cell sizes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.evaluation.events import Bands
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import SHOWN
from pipeline.report import case_findings as verdicts
from pipeline.report import case_tables, findings, tables
from pipeline.report.comparison import AUC, FAR, KEPT, OFF, RECALL, Comparison, Kind
from pipeline.report.figures import events, robustness
from pipeline.report.figures.style import illustrate
from pipeline.report.findings import Finding
from pipeline.report.render import anchor
from pipeline.report.result import day
from pipeline.report.section import Illustration, Section
from pipeline.report.selection import pick
from pipeline.report.study import Study
from pipeline.report.table import Table

UNITS = {"demolition": "degrees removed", "construction": "new walls"}
CHANGES = ("turned", *UNITS)
PANELS = (
    ("cells", "auc_top1"),
    ("cells", "recall_at_1"),
    ("distance", "auc_top1"),
    ("distance", "recall_at_1"),
)


def sections(study: Study, folder: Path, few: int) -> Iterator[Section]:
    """Draw the figures into `folder` and yield the sections that the study has."""
    rows = study.rows[(study.rows["kind"] == "") & (study.rows["sequence"] != "")]
    recipes = {name: study.recipe(name) for name in study.trained}
    n_way = {name: int(recipe["n_way"]) for name, recipe in recipes.items() if "n_way" in recipe}
    for alteration, sequences in study.settings.altered.items():
        # an alteration that is no change itself has several
        changes = (alteration,) if alteration in CHANGES else CHANGES
        altered_rows = rows[rows["sequence"].isin(sequences) & rows["change"].isin(["", *changes])]
        model_columns = ["method", "variant", "seed"]
        altered_models = altered_rows[altered_rows["change"] != ""][model_columns].drop_duplicates()
        make_section = (
            _structure if alteration in UNITS else _turned if alteration == "turned" else _glance
        )
        comparison = Comparison(altered_rows.merge(altered_models), n_way)
        yield make_section(study, folder, alteration, comparison)
    if stress := study.settings.stress:
        stress_rows = rows[rows["sequence"].isin(stress) & (rows["change"] == "")]
        yield _stress(study, folder, Comparison(stress_rows, n_way), stress)
    if study.settings.question == "robustness":
        yield _events(study, folder, few)
    if study.settings.cells:
        yield _cells(study, folder)


def _section(
    study: Study,
    kind: str,
    comparison: Comparison,
    conclusions: Sequence[Finding],
    illustrations: Sequence[Illustration],
    section_tables: Sequence[Table],
    name: str = "",
) -> Section:
    scope = findings.scope(
        study, len(comparison.sequences), max(comparison.seeds.values()), comparison.repeats
    )
    return Section(
        anchor(study.name, study.grid, name or kind),
        kind,
        values={"study": study},
        findings=(*conclusions, scope),
        illustrations=illustrations,
        tables=section_tables,
        sources=[study.folder("evaluate", study.grid, model) for model in study.trained],
        parameters={
            "budget": study.settings.budget,
            "train": study.train,
            "sequences": comparison.sequences,
        },
    )


def _both_tables(comparison: Comparison) -> list[Table]:
    return [
        case_tables.every_case(comparison, measures)
        for measures in (case_tables.BY_CELLS, case_tables.BY_DISTANCE)
    ]


def _turned(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """Fig. 10: queries turned by random angles."""
    kind = comparison.kinds[-1]
    ways = comparison.ways()
    gives_headings = any(
        np.isfinite(comparison.measurement(model, kind, OFF).mean) for model in comparison.models
    )
    measures = (AUC, KEPT, FAR, OFF) if gives_headings else (AUC, KEPT, FAR)
    figure = robustness.dots(
        comparison, measures, kind, f"Queries turned by random angles, {study.name}"
    )
    make_findings = (
        verdicts.kept,
        verdicts.nearly_always,
        verdicts.heading_errors,
        verdicts.chance,
    )
    illustrations = [
        illustrate(
            "turned",
            figure,
            study,
            folder,
            *(make_finding(comparison, kind) for make_finding in make_findings),
        )
    ]
    if len(ways) > 1:
        other_models = [
            model for model in comparison.ordered(kind, AUC) if model not in ways.values()
        ][:2]
        figure = robustness.ways(comparison, kind, other_models, f"N-way training, {study.name}")
        illustrations.append(illustrate("ways", figure, study, folder))
    conclusions = (verdicts.leader(comparison, kind, AUC), verdicts.n_ways(comparison, kind))
    section_tables = [*_both_tables(comparison), case_tables.on_sequences(comparison, kind, AUC)]
    return _section(study, alteration, comparison, conclusions, illustrations, section_tables)


def _structure(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """Fig. 9: queries with a wedge of directions removed, or with new walls."""
    worst = max(comparison.changes, key=lambda kind: (kind.level, kind.shadow))
    figure = robustness.levels(
        comparison, f"{alteration.capitalize()}, {study.name}", UNITS[alteration]
    )
    figure_findings = (
        verdicts.kept(comparison, worst),
        *verdicts.shadows(comparison),
        verdicts.nearly_always(comparison, worst),
        verdicts.chance(comparison, worst),
    )
    illustration = illustrate(
        "structure", figure, study, folder, *figure_findings, name=alteration, alteration=alteration
    )
    conclusions = [verdicts.leader(comparison, worst, measure) for measure in (AUC, KEPT)]
    section_tables = [
        *(case_tables.over_kinds(comparison, measure) for measure in (AUC, KEPT, FAR)),
        *_both_tables(comparison),
    ]
    return _section(study, alteration, comparison, conclusions, [illustration], section_tables)


def _glance(study: Study, folder: Path, alteration: str, comparison: Comparison) -> Section:
    """One or two cases of several alterations side by side."""
    figure = robustness.dots(
        comparison, (AUC, KEPT, FAR), Kind(), f"Altered queries at a glance, {study.name}"
    )
    figure_findings = [verdicts.kept(comparison, kind) for kind in comparison.changes]
    illustration = illustrate("glance", figure, study, folder, *figure_findings, name=alteration)
    conclusions = [verdicts.leader(comparison, kind, AUC) for kind in comparison.kinds]
    return _section(
        study,
        "glance",
        comparison,
        conclusions,
        [illustration],
        _both_tables(comparison),
        alteration,
    )


def _stress(
    study: Study, folder: Path, comparison: Comparison, stress: Mapping[str, str]
) -> Section:
    """Sequences that are hard as driven."""
    titles = {sequence: f"{day(sequence)}, {stress[sequence]}" for sequence in comparison.sequences}
    figure = robustness.sequences(comparison, titles, f"Sequences of stress, {study.name}")
    figure_findings = (
        verdicts.nearly_always(comparison, Kind()),
        verdicts.chance(comparison, Kind()),
    )
    conclusions = (
        verdicts.leader(comparison, Kind(), RECALL),
        verdicts.best_on_each(comparison, titles),
    )
    illustration = illustrate("stress", figure, study, folder, *figure_findings)
    return _section(
        study,
        "stress",
        comparison,
        conclusions,
        [illustration],
        [case_tables.stress(comparison, titles)],
    )


def _events(study: Study, folder: Path, few: int) -> Section:
    """Numbers by the distance to the nearest building that went up or came down."""
    rows = study.rows
    bands = _bands(rows)
    names = dict(zip((*bands.edges_m, np.inf), bands.names, strict=True))
    farthest = pick(rows, change=SHOWN, protocol=PROTOCOLS[0], number="seen", level=np.inf)
    models = [model for model in study.families if model in set(farthest["method"])]
    figure = events.by_distance(rows, models, names, few)
    recall, auc = (findings.near_changes(rows, number, names, few) for number in events.NEAR)
    return Section(
        anchor(study.name, study.grid, "events"),
        "events",
        values={"study": study},
        findings=(recall, findings.changes_counted(rows, bands.kinds, bands.edges_m[-1])),
        illustrations=[illustrate("events", figure, study, folder, auc)],
        tables=[
            tables.near_changes(rows, protocol, number, names)
            for protocol in PROTOCOLS
            for number in events.NEAR
        ],
        sources=[study.folder("events")],
        parameters={"edges_m": list(bands.edges_m), "kinds": list(bands.kinds), "few": few},
    )


def _bands(rows: pd.DataFrame) -> Bands:
    """The bands of distance that the rows are grouped by."""
    edges_m = sorted(
        edge for edge in rows.loc[rows["change"] == SHOWN, "level"].unique() if np.isfinite(edge)
    )
    ending = "_changes"
    change_numbers = rows.loc[
        rows["number"].str.endswith(ending) & (rows["method"] == ""), "number"
    ].unique()
    return Bands(edges_m, [number.removesuffix(ending) for number in change_numbers])


def _cells(study: Study, folder: Path) -> Section:
    """Fig. 11: the effect of the cell size; each method learns its places anew at every size."""
    sides_m = {
        grid.name: replace(study, grid=grid.name).cell_m for grid in study.settings.all_grids
    }
    grids = sorted(sides_m, key=lambda grid: sides_m[grid])
    methods = [method.name for method in study.settings.methods]
    sizes_m = [sides_m[grid] for grid in grids]
    table = study.table
    driven = table[
        (table[["change", "kind", "stress", "variant"]] == "").all(axis=1)
        & (table["seed"] == 0)
        & (table["sequence"] != "")
    ]
    values_by_key = {
        key: group.dropna().to_numpy()
        for key, group in driven.groupby(["method", "protocol", "number", "grid"])["value"]
    }
    values_by_panel = {
        (model, *panel): [values_by_key[model, *panel, grid] for grid in grids]
        for model in methods
        for panel in PANELS
    }
    oracle = {
        protocol: [values_by_key[methods[0], protocol, "oracle", grid].mean() for grid in grids]
        for protocol in PROTOCOLS
    }
    figure = robustness.cells(values_by_panel, sizes_m, oracle, f"The side of a cell, {study.name}")
    titled_values = [
        (
            {model: values_by_panel[model, *panel] for model in methods},
            f"{tables.TITLES[panel[1]]} by {panel[0]}",
        )
        for panel in PANELS
    ]
    figure_findings = [
        findings.best_at_each_size(*values_and_title, sizes_m) for values_and_title in titled_values
    ]
    return Section(
        anchor(study.name, "cells"),
        "cells",
        values={"study": study},
        findings=[
            findings.trend(*values_and_title, sizes_m)
            for values_and_title in (titled_values[0], titled_values[3])
        ],
        illustrations=[illustrate("cells", figure, study, folder, *figure_findings)],
        tables=[
            case_tables.cells(*values_and_title, sizes_m) for values_and_title in titled_values
        ],
        sources=[study.folder("evaluate", grid) for grid in grids],
    )
