"""The figure of a sweep: the scores of its jobs over a parameter that was swept.

In: the records of the jobs, each with its settings and its rows of numbers.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.core.errors import InputError
from pipeline.report.comparison import AUC, RECALL_BY_DISTANCE, Measure
from pipeline.report.figures.panels import Line, draw_lines, oracle
from pipeline.report.figures.style import DASHES, WIDTH_IN, below, figure, styled
from pipeline.report.table import MISSING
from pipeline.studies.colours import PALETTE
from pipeline.sweeps.record import Record

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")
FAINT: Any = {"alpha": 0.35, "linewidths": 0, "zorder": 2}  # a test sequence
CROSS: Any = {"ms": 5, "mew": 1.2, "clip_on": False, "zorder": 4}  # a job that failed
WIDE_RANGE = 20.0  # positive values whose ratio is larger have a logarithmic axis


def setting(job: Record, name: str) -> str:
    """The value of a parameter of a job, MISSING if not set; for `job` the job's number."""
    return str(job.number) if name == "job" else job.overrides.get(name, MISSING)


@styled
def response(jobs: Sequence[Record], swept: Sequence[str]) -> Figure:
    """The scores over one swept parameter: of the numeric ones, or of all, that with most values.

    There is a panel per protocol, and a line for each combination of the other parameters, whose
    points are joined along a numeric axis only. Raises InputError if every job failed.
    """
    if not any(job.rows for job in jobs):
        raise InputError("every job of the sweep failed, so there is nothing to draw")
    values = {name: [setting(job, name) for job in jobs] for name in (*swept, "job")}
    numeric = [name for name in swept if all(map(NUMBER.fullmatch, values[name]))]
    x_name = max(numeric or swept, key=lambda name: len(set(values[name])), default="job")
    is_numeric = all(map(NUMBER.fullmatch, values[x_name]))
    ticks = {
        value: float(value) if is_numeric else float(i)
        for i, value in enumerate(dict.fromkeys(values[x_name]))
    }
    lines: dict[str, list[tuple[float, Record]]] = {}
    for job in sorted(jobs, key=lambda job: (ticks[setting(job, x_name)], job.number)):
        other_names = [name for name in swept if name != x_name]
        label = ", ".join(f"{name.rpartition('.')[2]} {setting(job, name)}" for name in other_names)
        line = lines.setdefault(label or "mean of the test sequences", [])
        line.append((ticks[setting(job, x_name)], job))
    fig = figure(WIDTH_IN, 3.0, f"Over {x_name}, by both protocols")
    for axis, measure in zip(fig.subplots(1, 2), (AUC, RECALL_BY_DISTANCE), strict=True):
        _panel(axis, lines, measure, is_numeric)
        axis.set(xlabel=x_name, ylabel=measure.title)
        lowest = min(ticks.values())
        if lowest > 0 and max(ticks.values()) / lowest > WIDE_RANGE:
            axis.set_xscale("log")
        axis.set_xticks([*ticks.values()], [*ticks])
        axis.set_xticks([], minor=True)
        axis.margins(x=0.08)
        axis.grid(axis="y")
    below(fig, fig.axes[0].get_legend_handles_labels()[0], 4, handlelength=2.2)
    return fig


def _panel(
    axis: Axes,
    lines: Mapping[str, Sequence[tuple[float, Record]]],
    measure: Measure,
    is_numeric: bool,
) -> None:
    """Draw one measure: means as lines, test sequences as dots and failed jobs as crosses."""
    oracle_values_at: dict[float, list[float]] = {}  # x to the values of the oracle
    for i, (name, jobs) in enumerate(lines.items()):
        style = {
            "color": PALETTE[i % len(PALETTE)],
            "ls": DASHES[i // len(PALETTE) % len(DASHES)] if is_numeric else "",
            "marker": "o",
        }
        drawn = [(x, job.values(measure.protocol, measure.name)) for x, job in jobs]
        drawn = [(x, values) for x, values in drawn if values]
        means = [np.mean(values) for _, values in drawn]
        draw_lines(axis, [Line(name, [x for x, _ in drawn], means, style)])
        for x, values in drawn:
            axis.scatter([x] * len(values), values, 7, style["color"], **FAINT)
        for x, job in jobs:
            oracle_values_at.setdefault(x, []).extend(job.values(measure.protocol, "oracle"))
            if job.error is not None:
                lowest = axis.get_xaxis_transform()
                axis.plot(x, 0, "x", color=style["color"], transform=lowest, **CROSS)
    means_at = {
        x: float(np.mean(values)) for x, values in sorted(oracle_values_at.items()) if values
    }
    draw_lines(axis, [oracle(list(means_at), list(means_at.values()), "oracle recall@1")])
    axis.set_ylim(None, min(axis.get_ylim()[1], 1.005))
