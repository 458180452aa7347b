"""The sections of a study of robustness: perturbed queries, stress, real changes and cell sizes.

In: a study. Out: a section for each perturbation of its queries (turned queries, directions
removed, new walls), one on stress sequences, one on buildings that went up or came down, and one on
the cell size, each with its figures drawn (Fig. 9 to 11 of the SCI paper: Kim, Park and Kim, RA-L
2019).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.events import Bands
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import NEAR_CHANGE, PERTURBED, STRESS, UNPERTURBED, pick
from pipeline.evaluation.study_rows import SHOWN
from pipeline.report import findings, tables
from pipeline.report.comparison import (
    AUC,
    AUC_SHARE,
    HEADING_ERROR,
    RECALL,
    RECALL_BY_DISTANCE,
    UNPERTURBED_KIND,
    Comparison,
)
from pipeline.report.figures import events, robustness
from pipeline.report.findings import Finding
from pipeline.report.result import TITLES, day
from pipeline.report.section import Section, anchor, illustrate, section_of
from pipeline.report.study import StudyResults
from pipeline.report.table import Table

UNITS = {"demolition": "degrees removed", "construction": "new walls"}  # of their levels
CHANGES = ("turned", *UNITS)  # what a perturbation may do to a query
# The numbers that are shown over cell sizes: protocol and number.
PANELS = (
    ("cells", "auc_top1"),
    ("cells", "recall_at_1"),
    ("distance", "auc_top1"),
    ("distance", "recall_at_1"),
)


def sections(study: StudyResults, folder: Path, least_queries: int) -> Iterator[Section]:
    """Draw the figures into `folder` and yield the sections that the study has."""
    rows = study.rows[study.rows["sequence"] != ""]
    recipes = {name: study.recipe(name) for name in study.trained}
    n_way = {name: int(recipe["n_way"]) for name, recipe in recipes.items() if "n_way" in recipe}
    for perturbation, sequences in study.settings.perturbed.items():
        # a perturbation that is not named by its change has several, such as `glance`
        changes = (perturbation,) if perturbation in CHANGES else CHANGES
        day_rows = rows[rows["sequence"].isin(sequences)]
        is_perturbed = (day_rows["ask"] == PERTURBED) & day_rows["of"].str.startswith(changes)
        perturbed_rows = day_rows[is_perturbed | day_rows["ask"].isin([UNPERTURBED, STRESS])]
        models = day_rows.loc[is_perturbed, ["model", "seed"]]
        comparison = Comparison(perturbed_rows.merge(models.drop_duplicates()), n_way)
        make_section = _structure if perturbation in UNITS else _glance
        if perturbation == "turned":
            make_section = _turned
        yield make_section(study, folder, perturbation, comparison)
    if study.settings.stress:
        comparison = Comparison(pick(rows, ask=STRESS), n_way)
        yield _stress(study, folder, comparison)
    if study.settings.experiment == "robustness":
        yield _events(study, folder, least_queries)
    if study.settings.cells:
        yield _cells(study, folder)


def _compared(
    study: StudyResults,
    kind: str,
    comparison: Comparison,
    conclusions: Sequence[Finding],
    **parts: Any,
) -> Section:
    """A section of a comparison, whose last finding says what data it rests on."""
    scope = findings.scope(
        study, len(comparison.sequences), max(comparison.seeds.values()), comparison.repeats
    )
    return section_of(
        study,
        kind,
        findings=(*conclusions, scope),
        sources=[study.folder("evaluate", study.grid, model) for model in study.trained],
        parameters={
            "budget": study.settings.budget,
            "train": study.train,
            "sequences": comparison.sequences,
        },
        **parts,
    )


def _every_case(comparison: Comparison) -> list[Table]:
    return [tables.every_case(comparison, by) for by in (tables.BY_CELLS, tables.BY_DISTANCE)]


def _turned(
    study: StudyResults, folder: Path, perturbation: str, comparison: Comparison
) -> Section:
    """Fig. 10: queries turned by random angles."""
    kind = comparison.kinds[-1]
    ways = comparison.ways()
    errors = [
        comparison.measurement(model, kind, HEADING_ERROR).mean for model in comparison.models
    ]
    measures = (
        (AUC, AUC_SHARE, RECALL_BY_DISTANCE, HEADING_ERROR)
        if np.isfinite(errors).any()
        else (AUC, AUC_SHARE, RECALL_BY_DISTANCE)
    )
    best = [model for model in comparison.ordered(kind, AUC) if model not in ways.values()]
    n_way_figure = None
    if len(ways) > 1:
        n_way_heading = f"N-way training, {study.name}"
        n_way_figure = robustness.ways(comparison, kind, best[:2], n_way_heading)
    draw = partial(illustrate, study, folder)
    heading = f"Queries turned by random angles, {study.name}"
    return _compared(
        study,
        perturbation,
        comparison,
        (findings.leader(comparison, kind, AUC), findings.n_ways(comparison, kind)),
        illustrations=[
            draw(
                "turned",
                robustness.kinds(comparison, measures, kind, heading),
                findings.kept(comparison, kind),
                findings.nearly_always(comparison, kind),
                findings.heading_errors(comparison, kind),
                findings.variation(comparison, kind),
            ),
            draw("ways", n_way_figure),
        ],
        tables=[
            *_every_case(comparison),
            tables.on_sequences(comparison, kind, AUC),
        ],
    )


def _structure(
    study: StudyResults, folder: Path, perturbation: str, comparison: Comparison
) -> Section:
    """Fig. 9: queries with a wedge of directions removed, or with new walls."""
    worst = max(comparison.changes, key=lambda kind: (kind.level, kind.shadow))
    heading = f"{perturbation.capitalize()}, {study.name}"
    illustration = illustrate(
        study,
        folder,
        "structure",
        robustness.levels(comparison, heading, UNITS[perturbation]),
        findings.kept(comparison, worst),
        *findings.shadows(comparison),
        findings.nearly_always(comparison, worst),
        findings.variation(comparison, worst),
        name=perturbation,
        perturbation=perturbation,
    )
    return _compared(
        study,
        perturbation,
        comparison,
        [findings.leader(comparison, worst, measure) for measure in (AUC, AUC_SHARE)],
        illustrations=[illustration],
        tables=[
            *(
                tables.over_kinds(comparison, measure)
                for measure in (AUC, AUC_SHARE, RECALL_BY_DISTANCE)
            ),
            *_every_case(comparison),
        ],
    )


def _glance(
    study: StudyResults, folder: Path, perturbation: str, comparison: Comparison
) -> Section:
    """One or two levels of several perturbations side by side."""
    heading = f"Perturbed queries at a glance, {study.name}"
    illustration = illustrate(
        study,
        folder,
        "glance",
        robustness.kinds(
            comparison, (AUC, AUC_SHARE, RECALL_BY_DISTANCE), UNPERTURBED_KIND, heading
        ),
        *(findings.kept(comparison, kind) for kind in comparison.changes),
        name=perturbation,
    )
    return _compared(
        study,
        "glance",
        comparison,
        [findings.leader(comparison, kind, AUC) for kind in comparison.kinds],
        name=perturbation,
        illustrations=[illustration],
        tables=_every_case(comparison),
    )


def _stress(study: StudyResults, folder: Path, comparison: Comparison) -> Section:
    """Stress sequences, which are hard without a perturbation."""
    titles = {name: f"{day(name)}, {study.settings.stress[name]}" for name in comparison.sequences}
    illustration = illustrate(
        study,
        folder,
        "stress",
        robustness.sequences(comparison, titles, f"Sequences of stress, {study.name}"),
        findings.nearly_always(comparison, UNPERTURBED_KIND),
        findings.variation(comparison, UNPERTURBED_KIND),
    )
    return _compared(
        study,
        "stress",
        comparison,
        (
            findings.leader(comparison, UNPERTURBED_KIND, RECALL),
            findings.best_on_each(comparison, titles),
        ),
        illustrations=[illustration],
        tables=[tables.stress(comparison, titles)],
    )


def _events(study: StudyResults, folder: Path, least_queries: int) -> Section:
    """Numbers by the distance to the nearest building that went up or came down."""
    rows = study.rows
    levels_m = pick(rows, ask=NEAR_CHANGE, of=SHOWN)["at"].unique()
    changes = pick(rows, method="")["number"].str.extract("^(.*)_changes$")[0]
    bands = Bands(sorted(levels_m[np.isfinite(levels_m)]), [*changes.dropna().unique()])
    names = dict(zip((*bands.edges_m, np.inf), bands.names, strict=True))
    farthest = pick(
        rows, ask=NEAR_CHANGE, of=SHOWN, protocol=PROTOCOLS[0], number="seen", at=np.inf
    )
    models = [model for model in study.families if model in set(farthest["method"])]
    recall, auc = (
        findings.near_changes(rows, number, names, least_queries) for number in events.NEAR
    )
    figure = events.by_distance(rows, models, names, least_queries)
    return section_of(
        study,
        "events",
        findings=(recall, findings.changes_counted(rows, bands.kinds, bands.edges_m[-1])),
        illustrations=[illustrate(study, folder, "events", figure, auc)],
        tables=[
            tables.near_changes(rows, protocol, number, names)
            for protocol in PROTOCOLS
            for number in events.NEAR
        ],
        sources=[study.folder("events")],
        parameters={
            "edges_m": list(bands.edges_m),
            "kinds": list(bands.kinds),
            "few": least_queries,
        },
    )


def _cells(study: StudyResults, folder: Path) -> Section:
    """Fig. 11: the effect of the cell size; each method learns its places again at every size."""
    sides_m = {
        grid.name: replace(study, grid=grid.name).cell_m for grid in study.settings.all_grids
    }
    grids = sorted(sides_m, key=sides_m.__getitem__)
    sizes_m = [sides_m[grid] for grid in grids]
    methods = [method.name for method in study.settings.methods]
    unperturbed = pick(study.table, ask=UNPERTURBED, variant="", seed=0)
    unperturbed = unperturbed[unperturbed["sequence"] != ""]
    by_grid = {
        key: group.dropna().to_numpy()  # (sequence,)
        for key, group in unperturbed.groupby(["method", "protocol", "number", "grid"])["value"]
    }
    panels: dict[tuple[str, str, str], list[NDArray[np.float64]]] = {}
    over_sizes = []  # for each panel: model to values at each size, title, sizes
    for by, name in PANELS:
        values = {model: [by_grid[model, by, name, grid] for grid in grids] for model in methods}
        panels |= {(model, by, name): by_size for model, by_size in values.items()}
        over_sizes.append((values, f"{TITLES[name]} by {by}", sizes_m))
    oracle = {
        protocol: [by_grid[methods[0], protocol, "oracle", grid].mean() for grid in grids]
        for protocol in PROTOCOLS
    }
    illustration = illustrate(
        study,
        folder,
        "cells",
        robustness.cells(panels, sizes_m, oracle, f"The side of a cell, {study.name}"),
        *(findings.best_at_each_size(*panel) for panel in over_sizes),
    )
    section = section_of(
        study,
        "cells",
        findings=[findings.trend(*panel) for panel in (over_sizes[0], over_sizes[-1])],
        illustrations=[illustration],
        tables=[tables.over_cell_sizes(*panel) for panel in over_sizes],
        sources=[study.folder("evaluate", grid) for grid in grids],
    )
    return replace(section, name=anchor(study.name, "cells"))  # it is of all cell sizes
