"""The numbers of a sweep over the parameters that were swept."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.core.errors import InputError
from pipeline.report.comparison import AUC, FAR, Measure
from pipeline.report.figures.style import DASHES, WIDTH_IN, below, figure, styled
from pipeline.report.table import MISSING
from pipeline.studies.colours import PALETTE

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")
WIDE_RANGE = 20.0  # positive values whose ratio is larger have a logarithmic axis


@dataclass(frozen=True, eq=False)
class SweepJob:
    """One job of a sweep."""

    number: int
    values: Mapping[str, str]  # parameter to value, such as {"grid.cell_m": "5"}
    # protocol and number to one value a test sequence; none of a failed job
    numbers: Mapping[tuple[str, str], Sequence[float]]
    error: str | None  # why it failed
    held_out_auc: float | None = None

    def value(self, name: str) -> str:
        """The value of a parameter, MISSING if not set; for `job` the job's number."""
        return str(self.number) if name == "job" else self.values.get(name, MISSING)

    def finite(self, protocol: str, name: str) -> list[float]:
        """The finite values of one number, one a test sequence."""
        return [value for value in self.numbers.get((protocol, name), ()) if np.isfinite(value)]


@styled
def response(jobs: Sequence[SweepJob], swept: Sequence[str]) -> Figure:
    """The scores over the swept parameter with most values, numeric if any is.

    A panel a protocol, a line for each combination of the other parameters. Points are joined along
    a numeric axis only. Raises InputError where every job failed.
    """
    if not any(job.numbers for job in jobs):
        raise InputError("every job of the sweep failed, so there is nothing to draw")
    values = {name: [job.value(name) for job in jobs] for name in (*swept, "job")}
    numeric = [name for name in swept if all(map(NUMBER.fullmatch, values[name]))]
    along = max(numeric or swept, key=lambda name: len(set(values[name])), default="job")
    joined = all(map(NUMBER.fullmatch, values[along]))
    ticks = {
        value: float(value) if joined else float(i)
        for i, value in enumerate(dict.fromkeys(values[along]))
    }
    lines: dict[str, list[tuple[float, SweepJob]]] = {}
    for job in sorted(jobs, key=lambda job: (ticks[job.value(along)], job.number)):
        name = ", ".join(
            f"{name.rpartition('.')[2]} {job.value(name)}" for name in swept if name != along
        )
        lines.setdefault(name or "mean of the test sequences", []).append(
            (ticks[job.value(along)], job)
        )
    fig = figure(WIDTH_IN, 3.0, f"Over {along}, by both protocols")
    for axis, measure in zip(fig.subplots(1, 2), (AUC, FAR), strict=True):
        _panel(axis, lines, measure, joined)
        axis.set(xlabel=along, ylabel=measure.title)
        if min(ticks.values()) > 0 and max(ticks.values()) / min(ticks.values()) > WIDE_RANGE:
            axis.set_xscale("log")
        axis.set_xticks([*ticks.values()], [*ticks])
        axis.set_xticks([], minor=True)
        axis.margins(x=0.08)
        axis.grid(axis="y")
    below(fig, fig.axes[0].get_legend_handles_labels()[0], 4, handlelength=2.2)
    return fig


def _panel(
    axis: Axes,
    lines: Mapping[str, Sequence[tuple[float, SweepJob]]],
    measure: Measure,
    joined: bool,
) -> None:
    """Draw means as lines, test sequences as dots and failed jobs as crosses.

    The mean oracle of the jobs at each place is grey.
    """
    oracle: dict[float, list[float]] = {}
    for i, (name, jobs) in enumerate(lines.items()):
        tint = PALETTE[i % len(PALETTE)]
        dash = DASHES[i // len(PALETTE) % len(DASHES)] if joined else ""
        drawn_jobs = [
            (x, values) for x, job in jobs if (values := job.finite(measure.protocol, measure.name))
        ]
        means = [np.mean(values) for _, values in drawn_jobs]
        axis.plot(
            [x for x, _ in drawn_jobs],
            means,
            color=tint,
            ls=dash,
            marker="o",
            ms=4,
            mec="white",
            mew=0.6,
            label=name,
            zorder=3,
        )
        for x, values in drawn_jobs:
            axis.scatter([x] * len(values), values, 7, tint, alpha=0.35, linewidths=0, zorder=2)
        for x, job in jobs:
            oracle.setdefault(x, []).extend(job.finite(measure.protocol, "oracle"))
            if job.error is not None:
                low = axis.get_xaxis_transform()
                axis.plot(
                    x, 0, "x", ms=5, mew=1.2, color=tint, clip_on=False, zorder=4, transform=low
                )
    best = np.array(sorted((x, np.mean(values)) for x, values in oracle.items() if values)).reshape(
        -1, 2
    )
    axis.plot(
        *best.T,
        marker="." if len(best) == 1 else "",
        lw=0.9,
        color="0.6",
        label="oracle recall@1",
        zorder=1,
    )
    axis.set_ylim(None, min(axis.get_ylim()[1], 1.005))
