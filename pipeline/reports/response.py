"""How the numbers of a sweep move with the parameters that were swept."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.errors import InputError
from pipeline.reports.style import PALETTE, STYLE, TEXT_WIDTH_IN, figure
from pipeline.reports.table import mean

if TYPE_CHECKING:
    from pipeline.reports.sweep import Job

PANELS = (("cells", "auc_top1", "AUC, top-1, by cells"), ("distance", "recall_at_1", "recall@1 by distance"))
"""Protocol, key in metrics.json, name."""
LINES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))
"""Once the palette is used up, its colours come again with another kind of line."""
WIDE_RANGE = 20.0
"""Values that span more than this are spaced by their logarithm."""

Place = Callable[["Job"], float]


@matplotlib.rc_context(STYLE)
def draw(jobs: Sequence["Job"], swept: Sequence[str], simulated: bool) -> Figure:
    """Both panels over the swept parameter with most values, numeric if any is; a line for each value of the others.

    Values that are no numbers have no between: their points are not joined.
    """
    if not any(job.numbers for job in jobs):
        raise InputError("no job of the sweep went well, so there is nothing to draw")
    along = _along(jobs, swept)
    ticks = _ticks([_told(job, along) for job in jobs])
    others = [name for name in swept if name != along]
    lines: dict[str, list[Job]] = {}
    for job in sorted(jobs, key=lambda job: (ticks[_told(job, along)], job.number)):
        lines.setdefault(", ".join(f"{name.rpartition('.')[2]} {job.told(name)}" for name in others), []).append(job)
    fig = figure(TEXT_WIDTH_IN, 3.0, simulated, f"Over {along}, by both protocols")
    for axis, (protocol, name, label) in zip(fig.subplots(1, len(PANELS)), PANELS, strict=True):
        _panel(axis, lines, lambda job: ticks[_told(job, along)], protocol, name, joined=None not in map(_float, ticks))
        axis.set(xlabel=along, ylabel=label)
        if min(ticks.values()) > 0 and max(ticks.values()) / min(ticks.values()) > WIDE_RANGE:
            axis.set_xscale("log")
        axis.set_xticks([*ticks.values()], [*ticks])
        axis.set_xticks([], minor=True)
        axis.margins(x=0.08)
        axis.grid(axis="y", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
    handles, labels = fig.axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), frameon=False, handlelength=2.2)
    return fig


def _panel(axis: Axes, lines: Mapping[str, Sequence["Job"]], x: Place, protocol: str, name: str, joined: bool) -> None:
    """Means as lines, test sequences as dots, the mean oracle of the jobs at each place in grey, failed jobs as crosses."""
    failed = []
    for i, (label, jobs) in enumerate(lines.items()):
        tint, kind = PALETTE[i % len(PALETTE)], LINES[i // len(PALETTE) % len(LINES)]
        went_well = [job for job in jobs if job.values(protocol, name)]
        means = [(x(job), mean(job.values(protocol, name))) for job in went_well]
        look: Any = {"marker": "o", "ms": 4, "mec": "white", "mew": 0.6, "color": tint}
        axis.plot(
            *np.array(means, float).reshape(-1, 2).T,
            ls=kind if joined else "",
            label=label or "mean of the test sequences",
            zorder=3,
            **look,
        )
        dots = np.array([(x(job), value) for job in went_well for value in job.values(protocol, name)], float).reshape(-1, 2)
        axis.scatter(dots[:, 0], dots[:, 1], 7, tint, alpha=0.35, linewidths=0, zorder=2)
        failed += [(x(job), tint) for job in jobs if job.error is not None]
    everyone = [job for jobs in lines.values() for job in jobs if job.values(protocol, "oracle")]
    places = sorted({x(job) for job in everyone})
    oracle = [
        mean([value for job in everyone if x(job) == place for value in job.values(protocol, "oracle")]) for place in places
    ]
    dot = "." if len(places) == 1 else ""
    axis.plot(places, np.array(oracle, float), marker=dot, lw=0.9, color="0.6", label="oracle recall@1", zorder=1)
    low, high = axis.get_ylim()
    for place, tint in failed:
        axis.plot(place, low, "x", ms=5, mew=1.2, color=tint, clip_on=False, zorder=4)
    axis.set_ylim(low, min(high, 1.005))


def _along(jobs: Sequence["Job"], swept: Sequence[str]) -> str:
    """What the x axis shows: the first parameter with most values, of the numeric ones if there are any."""
    values = {name: {job.told(name) for job in jobs} for name in swept}
    numeric = [name for name in swept if all(_float(value) is not None for value in values[name])]
    return max(numeric or swept, key=lambda name: len(values[name]), default="job")


def _ticks(told: Sequence[str]) -> dict[str, float]:
    """Where each value lies along the axis: at its number, or in the order they come where one is no number."""
    numbers = {value: _float(value) for value in told}
    if None in numbers.values():
        return {value: float(i) for i, value in enumerate(numbers)}
    return {value: number for value, number in numbers.items() if number is not None}


def _told(job: "Job", name: str) -> str:
    return str(job.number) if name == "job" else job.told(name)


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
