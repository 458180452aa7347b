"""Figures of ageing, of real changes and of sweeps draw the numbers that they are given."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.evaluation.rows import row, table
from pipeline.report.figures import ageing, events
from pipeline.report.figures.ageing import FollowedNumber
from pipeline.report.figures.style import colour, save
from pipeline.report.figures.sweep import response
from pipeline.sweeps.record import Record
from tests.report.figures.made import saved_alike, words

DAYS = (0.0, 100.0, 200.0, 300.0)
AUC = FollowedNumber("cells", "auc_top1", "AUC, by cells")
NOVELTY = FollowedNumber("distance", "novelty_percentile", "novelty, by distance")
NONE = (np.nan,) * 3


def line(
    model: str,
    slope: tuple[float, float, float],
    followed: FollowedNumber = AUC,
    values: tuple[float, ...] = (1.0, 0.9, 0.7, 0.6),
) -> list[dict[str, Any]]:
    """Rows of one number of one model, whose values on the days lie on the fitted line."""
    protocol, number, _ = followed
    rows = [{"method": model} | row(f"{number}_per_100_days", protocol, *slope)]
    for days, value in zip(DAYS, values, strict=False):
        place = {"method": model, "sequence": f"day {days:g}", "days": days}
        rows += [place | row(name, protocol, value) for name in (number, f"{number}_line")]
    return rows


ROWS = table(
    [
        *line("sci", (-0.14, -0.2, -0.08)),
        *line("m2dp", (-0.005, -0.1, 0.1)),
        *line("oracle", (0.0, -0.1, 0.1)),
        *line("sci", (1.26, np.nan, np.nan), NOVELTY),
        *line("m2dp", NONE, NOVELTY, (np.nan,) * 4),
    ]
)
FOLLOWED = (AUC, NOVELTY)


def test_ageing_shows_each_sequence_and_the_slope_bold_where_it_is_clear() -> None:
    fig = ageing.lines(ROWS, FOLLOWED)
    assert [axis.get_title() for axis in fig.axes] == [
        "AUC\nby cells",
        "novelty\nby distance",
        "",
        "",
    ]
    assert [axis.get_ylabel() for axis in fig.axes] == ["sci", "", "m2dp", ""]
    dots = next(one for one in fig.axes[0].lines if one.get_marker() == "o")
    assert dots.get_xydata() == pytest.approx(np.stack([DAYS, (1.0, 0.9, 0.7, 0.6)], axis=1))
    weights = {text.get_text(): text.get_weight() for axis in fig.axes for text in axis.texts}
    assert weights == {"−0.140": "bold", "−0.005": "normal", "+1.3": "normal"}


def test_slopes_are_filled_where_they_are_clear() -> None:
    fig = ageing.slopes(ROWS, FOLLOWED)
    assert [tick.get_text() for tick in fig.axes[0].get_yticklabels()] == ["sci", "m2dp", "oracle"]
    fills = {
        float(one.get_xdata()[0]): one.get_markerfacecolor()
        for one in fig.axes[0].lines
        if one.get_marker() == "o"
    }
    assert (fills[-0.14], fills[-0.005]) == (colour("sci"), "white")


@pytest.mark.parametrize("draw", [ageing.lines, ageing.slopes])
def test_ageing_of_nothing_shows_no_nan(draw, tmp_path: Path) -> None:
    for values in ((np.nan,) * 4, (np.nan,)):
        nothing = table(line("sci", NONE, values=values))
        fig = saved_alike(lambda rows=nothing: draw(rows, (AUC,)), tmp_path)
        assert not [text for text in words(fig) if "nan" in text.lower()]
    with pytest.raises(InputError, match="at least one model"):
        draw(table(line("oracle", NONE)), (AUC,))


def test_bands_of_few_queries_are_pale(tmp_path: Path) -> None:
    """Of 29 seen queries near a change that shows, and of 50 near one to come; 500 are far off."""
    bands = {25.0: "0–25 m", np.inf: "over 25 m"}
    numbers = {
        ("change shown", 25.0): (29, 5, (0.2, 0.1, 0.3)),
        ("change to come", 25.0): (50, 5, (0.7, 0.6, 0.8)),
        **dict.fromkeys(
            (("change shown", np.inf), ("change to come", np.inf)), (500, 50, (0.9, 0.8, 0.95))
        ),
    }
    rows = []
    for (change, level), (seen, unseen, recall) in numbers.items():
        place = {"method": "sci", "change": change, "level": level}
        for protocol in ("cells", "distance"):
            rows += [place | row("seen", protocol, seen), place | row("unseen", protocol, unseen)]
            rows.append(place | row("recall_at_1", protocol, *recall))
            auc = NONE if level == 25.0 else recall
            rows.append(place | row("auc_exact_top1", protocol, *auc))
    fig = saved_alike(lambda: events.by_distance(table(rows), ["sci"], bands, 30), tmp_path)
    shades = {float(np.asarray(one.get_ydata())[0]): one.get_alpha() for one in fig.axes[0].lines}
    assert (shades[0.2], shades[0.7], shades[0.9]) == (0.3, 1.0, 1.0)
    assert {"recall@1, by cells", "exact AUC, by distance", "0–25", ">25", "29", "550"} <= set(
        words(fig)
    )


CAMPUS: Any = {"dataset": "campus", "simulated": True, "method": "sci"}


def job(number: int, cell: str, n_way: str, auc: float, error: str | None = None) -> Record:
    rows = [
        *(row("auc_top1", "cells", value) for value in (auc, auc - 0.2, np.nan)),
        row("recall_at_1", "distance", 0.5),
        row("oracle", "cells", 0.9),
    ]
    overrides = {"grid.cell_m": cell, "method.n_way": n_way}
    return Record(number, overrides, **CAMPUS, error=error, rows=[] if error else rows)


BROKEN = job(3, "10", "7", 0.0, "n_way=7: must divide 120")


def test_a_sweep_joins_means_over_the_first_numeric_parameter_with_most_values(
    tmp_path: Path,
) -> None:
    jobs = [
        BROKEN,
        job(0, "5", "1", 0.7),
        job(1, "5", "2", 0.8),
        job(2, "10", "1", 0.9),
        job(4, "20", "2", 0.9),
    ]
    fig = response(jobs, ("grid.cell_m", "method.n_way"))
    axis = fig.axes[0]
    assert axis.get_xticks().tolist() == [10, 5, 20]
    labels = [text.get_text() for text in fig.legends[0].get_texts()]
    assert labels == ["n_way 1", "n_way 2", "n_way 7", "oracle recall@1"]
    one, two = (line for line in axis.lines if line.get_label() in ("n_way 1", "n_way 2"))
    assert one.get_xydata() == pytest.approx(np.array([[5, 0.6], [10, 0.8]]))
    assert two.get_xydata() == pytest.approx(np.array([[5, 0.7], [20, 0.8]]))
    assert [list(line.get_xdata()) for line in axis.lines if line.get_marker() == "x"] == [
        [10]
    ]  # the job that failed
    save(fig, tmp_path / "a.svg", True)  # a warning of the layout would be an error


def test_words_are_not_joined_a_sweep_of_one_job_has_a_figure_and_one_in_which_all_failed_has_none() -> (
    None
):
    jobs = [
        Record(i, {"method.colormap": name}, **CAMPUS, rows=[row("auc_top1", "cells", 0.5)])
        for i, name in enumerate(("jet", "grey"))
    ]
    (line, *_) = response(jobs, ("method.colormap",)).axes[0].lines
    assert (line.get_linestyle(), list(line.get_xdata())) == ("None", [0, 1])
    assert response(jobs[:1], ()).axes[0].get_xlabel() == "job"
    with pytest.raises(InputError, match="nothing to draw"):
        response([BROKEN], ("grid.cell_m",))
