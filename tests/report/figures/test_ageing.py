"""Figures of ageing, of real changes and of sweeps."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.report.figures import ageing, events
from pipeline.report.figures.ageing import AgeingLine
from pipeline.report.figures.style import colour, save
from pipeline.report.figures.sweep import SweepJob, response
from tests.report.figures.made import saved_alike, words

DAYS = np.array([0.0, 100.0, 200.0, 300.0])
NAN = np.full((4, 3), np.nan)


def line(model: str, slope: tuple[float, float, float], rises: bool = False) -> AgeingLine:
    values = NAN.copy()
    values[:, 0] = (1.0, 0.9, 0.7, 0.6)
    title = "novelty, by distance" if rises else "AUC, by cells"
    return AgeingLine(model, title, rises, DAYS, values, values, np.array(slope))


ROWS = [
    *(
        line("sci", (-0.14, -0.2, -0.08)),
        line("m2dp", (-0.005, -0.1, 0.1)),
        line("oracle", (0.0, -0.1, 0.1)),
    ),
    *(
        line("sci", (1.26, np.nan, np.nan), rises=True),
        AgeingLine("m2dp", "novelty, by distance", True, DAYS, NAN, NAN, NAN[0]),
    ),
]


def test_ageing_shows_each_sequence_and_the_slope_bold_where_it_is_clear() -> None:
    fig = ageing.lines(ROWS)
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
    fig = ageing.slopes(ROWS)
    assert [tick.get_text() for tick in fig.axes[0].get_yticklabels()] == ["sci", "m2dp", "oracle"]
    fills = {
        float(one.get_xdata()[0]): one.get_markerfacecolor()
        for one in fig.axes[0].lines
        if one.get_marker() == "o"
    }
    assert (fills[-0.14], fills[-0.005]) == (colour("sci"), "white")


@pytest.mark.parametrize("draw", [ageing.lines, ageing.slopes])
def test_ageing_of_nothing_shows_no_nan(draw, tmp_path: Path) -> None:
    nothing = [
        AgeingLine("sci", "AUC, by cells", False, days, NAN[: len(days)], NAN[: len(days)], NAN[0])
        for days in (DAYS, DAYS[:0])
    ]
    for rows in (nothing[:1], nothing[1:]):
        assert not [
            text
            for text in words(saved_alike(lambda rows=rows: draw(rows), tmp_path))
            if "nan" in text.lower()
        ]
    with pytest.raises(InputError, match="at least one model"):
        draw([])


def test_bands_of_few_queries_are_pale(tmp_path: Path) -> None:
    far = (0.9, 0.8, 0.95)
    nan = (np.nan,) * 3
    few, many = (
        events.BandValues(
            np.array([seen, 500]), np.array([5, 50]), np.array([near, far]), np.array([nan, far])
        )
        for seen, near in ((29, (0.2, 0.1, 0.3)), (50, (0.7, 0.6, 0.8)))
    )
    given = {
        ("sci", by, shown): few if shown else many
        for by in ("cells", "distance")
        for shown in (True, False)
    }
    fig = saved_alike(lambda: events.by_distance(given, ["0–25 m", "over 25 m"], 30), tmp_path)
    shades = {float(np.asarray(one.get_ydata())[0]): one.get_alpha() for one in fig.axes[0].lines}
    assert (shades[0.2], shades[0.7], shades[0.9]) == (0.3, 1.0, 1.0)
    assert {"recall@1, by cells", "exact AUC, by distance", "0–25", ">25", "29", "550"} <= set(
        words(fig)
    )


def job(number: int, cell: str, n_way: str, auc: float, error: str | None = None) -> SweepJob:
    found = {
        ("cells", "auc_top1"): (auc, auc - 0.2, np.nan),
        ("distance", "recall_at_1"): (0.5,),
        ("cells", "oracle"): (0.9,),
    }
    return SweepJob(
        number, {"grid.cell_m": cell, "method.n_way": n_way}, {} if error else found, error
    )


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
        SweepJob(i, {"method.colormap": name}, {("cells", "auc_top1"): (0.5,)}, None)
        for i, name in enumerate(("jet", "grey"))
    ]
    (line, *_) = response(jobs, ("method.colormap",)).axes[0].lines
    assert (line.get_linestyle(), list(line.get_xdata())) == ("None", [0, 1])
    assert response(jobs[:1], ()).axes[0].get_xlabel() == "job"
    with pytest.raises(InputError, match="nothing to draw"):
        response([BROKEN], ("grid.cell_m",))
