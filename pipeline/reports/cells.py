"""Fig. 11 of the SCI paper: what the side of a grid cell does to each method, which learns its places anew at every size."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.reports.cells_findings import best, trend
from pipeline.reports.cells_numbers import Evaluated, average, deviation, methods, oracle, values
from pipeline.reports.result import by_method
from pipeline.reports.section import Section, Shown
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, colour, figure, name_at_the_end, save
from pipeline.reports.table import Table, spread

PANELS = (
    ("cells", "auc_top1", "AUC top-1 by cells"),
    ("cells", "recall_at_1", "recall@1 by cells"),
    ("distance", "auc_top1", "AUC top-1 by distance"),
    ("distance", "recall_at_1", "recall@1 by distance"),
)
"""Protocol, number and name of each panel."""


QUESTION = "How large should a place be?"


READ = (
    "One line a method, learned anew at each size: means over the test sequences, bars are deviations over them. By cells each"
    " size means other places and other seen queries, and the oracle's recall@1 in grey says how much is a matter of borders; so"
    " compare sizes by distance."
)


CAVEAT = (
    "By cells, a query is seen at one size and unseen at another, so those numbers compare methods at one size; by distance the"
    " queries are the same, but a method that answers with the middle of a place is off by up to half a cell's diagonal even when"
    " the place is right."
)


def section(
    folder: Path,
    dataset: str,
    evaluated: Evaluated,
    cell_m: Mapping[str, float],
    simulated: bool,
    sources: Sequence[str],
    parameters: Mapping[str, Any],
) -> Section:
    """Draw Fig. 11 into `folder` and tell of it; `cell_m` is the side of each grid's cells.

    Raises InputError where nothing was evaluated.
    """
    if not any(evaluated.values()):
        raise InputError("a section on cells needs at least one evaluation")
    grids = sorted((grid for grid in evaluated if evaluated[grid]), key=lambda grid: cell_m[grid])
    ordered = {grid: evaluated[grid] for grid in grids}
    path = save(draw(ordered, cell_m, simulated, f"The side of a cell, {dataset}"), folder / "cells.svg")
    size = f"{cell_m[grids[0]]:g} to {cell_m[grids[-1]]:g} m"
    count = len({result.sequence for results in ordered.values() for result in results})
    asked = f"Asked on {'simulated ' if simulated else ''}{dataset}, cells of {size}, {count} test sequence{'s' * (count != 1)}"
    budget = f", budget `{parameters['budget']}`" if "budget" in parameters else ""
    tables = [(f"{name} (± over the test sequences)", table(ordered, cell_m, *key)) for *key, name in PANELS]
    tables.append(("What is asked at each size, by cells (± over the test sequences)", asked_of(ordered, cell_m)))
    return Section(
        f"{dataset}-cells",
        f"Cells: {dataset} (Fig. 11)",
        QUESTION,
        (*(trend(ordered, cell_m, *panel) for panel in (PANELS[0], PANELS[3])), CAVEAT, f"{asked}{budget}."),
        simulated,
        (Shown(path.name, "The side of a cell (Fig. 11)", READ, " ".join(best(ordered, cell_m, *panel) for panel in PANELS)),),
        tuple(tables),
        tuple(sources),
        parameters,
    )


@matplotlib.rc_context(STYLE)
def draw(evaluated: Evaluated, cell_m: Mapping[str, float], simulated: bool, heading: str) -> Figure:
    """A panel a number of `PANELS`, over the sizes; each method a little beside the others."""
    names, at = methods(evaluated), np.arange(len(evaluated))
    panel_in = 0.6 + 0.125 * max(len(names) + 1, 9)
    fig = figure(TEXT_WIDTH_IN, 0.3 + 2 * (0.45 + panel_in), simulated, heading)
    for axis, (protocol, name, title) in zip(fig.subplots(2, 2).flat, PANELS, strict=True):
        ends: list[tuple[str, str, NDArray[np.float64]]] = []
        for i, method in enumerate(names):
            found = [values(results, method, protocol, name) for results in evaluated.values()]
            points = np.stack([at + 0.24 * ((i + 0.5) / len(names) - 0.5), [average(one) for one in found]], axis=1)
            axis.errorbar(
                *points.T, [deviation(one) for one in found], color=colour(method), lw=1.1, elinewidth=0.6, marker="o", ms=3.5,
                mec="white", mew=0.4, zorder=3,
            )  # fmt: skip
            ends += [(method, colour(method), points)] if np.isfinite(points[-1, 1]) else []
        if name == "recall_at_1":
            best_there = np.array([[x, oracle(results, protocol)] for x, results in zip(at, evaluated.values(), strict=True)])
            axis.plot(*best_there.T, color="0.6", lw=0.8, marker="." if len(best_there) == 1 else "", zorder=2)
            ends += [("oracle", QUIET, best_there)]
        shown = np.array([0.9, *axis.dataLim.intervaly])
        low = max(0.0, float(np.floor(shown[np.isfinite(shown)].min() * 10) / 10))
        axis.set_ylim(low, 1.0 + 0.03 * (1.0 - low))
        axis.set_xticks(at, [f"{cell_m[grid]:g} m" for grid in evaluated])
        axis.set_title(title, loc="left", pad=8)
        axis.grid(axis="y", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
        name_at_the_end(axis, ends, gap=1.03 * (1.0 - low) * 0.125 / panel_in)
    return fig


def table(evaluated: Evaluated, cell_m: Mapping[str, float], protocol: str, name: str) -> Table:
    """A row a method, the best at the largest cells above; a column a size."""
    last = list(evaluated.values())[-1]
    order = sorted(methods(evaluated), key=lambda method: -np.nan_to_num(average(values(last, method, protocol, name)), nan=-1))
    rows = [(method, *(spread(values(results, method, protocol, name), 3) for results in evaluated.values())) for method in order]
    return Table(("method", *(f"{cell_m[grid]:g} m" for grid in evaluated)), tuple(rows), words=1)


def asked_of(evaluated: Evaluated, cell_m: Mapping[str, float]) -> Table:
    """A row a size: how many queries are seen, and how many the oracle places right."""
    rows = []
    for grid, results in evaluated.items():
        group = next(iter(by_method(results).values()))
        seen = [float(result.evaluation.cells.seen.mean()) for result in group]
        told = spread([result.number("cells", "oracle") for result in group], 3)
        rows.append((f"{cell_m[grid]:g} m", str(len(group)), spread(seen, 3), told))
    return Table(("cell", "test sequences", "share of queries seen", "oracle recall@1"), tuple(rows), words=1)
