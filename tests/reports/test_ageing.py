"""The section on ageing: what it says follows from the numbers, and it says no more than they bear."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from pipeline.evaluation.ageing import Ageing
from pipeline.reports import ageing, ageing_figures
from pipeline.reports.ageing_lines import MEASURES, ORACLE, Aged, aged, series
from pipeline.reports.result import Result
from pipeline.reports.section import Section
from pipeline.reports.style import SIMULATED, save
from tests.reports.made import result

DAYS, FALLING = (0, 100, 200, 300), (1.0, 0.9, 0.7, 0.6)
"""A slope of −.14 [−.201, −.079] per 100 days, a tenth lost after 72 [54, 117] days: see the tests of evaluation.ageing."""
LEVEL = (0.8, 0.7, 0.8, 0.75)
KNOWN = {"sci": np.array([0.1, 0.15, 0.19, 0.3])}
HEADING, AREA = MEASURES[:2]


def year(method: str, values: tuple[float, ...], days: tuple[int, ...] = DAYS) -> list[Result]:
    """The same evaluation over and over, with other numbers in the metrics."""
    one, names = result(method), [m.name for m in MEASURES if m.protocol == "cells"]
    return [
        replace(one, sequence=f"2012-{day:03}", numbers={**one.numbers, "days": day, "cells": one.numbers["cells"] | told})
        for day, value in zip(days, values, strict=True)
        for told in [dict.fromkeys(names, value)]
    ]


RESULTS = year("sci", FALLING) + year("m2dp", LEVEL)


def of(lines: list[Aged], method: str, key: str) -> Aged:
    return next(one for one in lines if one.method == method and one.measure.key == key)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Section, Path]:
    folder = tmp_path_factory.mktemp("ageing")
    section = ageing.section(folder, "campus-10m-ageing", RESULTS, KNOWN, Ageing(), True, ["artifacts/evaluate"], {"cell_m": 10})
    section.write(folder)
    return section, folder


def test_the_section_stands_in_its_folder_and_is_read_back(made: tuple[Section, Path]) -> None:
    section, folder = made
    assert Section.read(folder) == section
    assert {path.name for path in folder.iterdir()} == {
        *("section.json", "campus-10m-ageing.md", "ageing.svg", "ageing_slopes.svg")
    }
    assert section.parameters == {"cell_m": 10, "ageing.loss": 0.1, "ageing.level": 0.95}


def test_what_falls_is_told_with_the_day_to_train_again_and_what_does_not_with_what_could_hide(
    made: tuple[Section, Path],
) -> None:
    # m2dp: slope −.005 per 100 days, residuals .03 −.065 .04 −.005, s² = .003375, so the interval reaches further down
    # by 4.3027 √(.003375 / 50,000) = .00112 a day: a loss of .117 in all
    answer = made[0].prose()
    assert "`sci` −0.140 [−0.201, −0.079] per 100 days and has lost 10 % after 72 [54, 117] days: train again by then." in answer
    assert "For the others no ageing is shown within 300 days, so nothing says retrain;" in answer
    assert "a loss of up to 0.117 per 100 days (`m2dp`) cannot be ruled out" in answer


def test_a_day_after_the_last_sequence_is_said_to_be_extrapolated() -> None:
    lines = aged(year("sci", (0.8, 0.798, 0.796, 0.793)), {}, Ageing())  # −.0023 per 100 days: .08 is lost after 3,479
    text = ageing.told(lines, HEADING, Ageing())
    assert "not within the 300 days tested, but by extrapolation, has lost 10 %" in text
    one = of(lines, "sci", HEADING.key)
    assert ageing.verdict(one.line, one.measure, 0.1) == "∞ [2631, ∞], extrapolated"


def test_two_sequences_say_nothing_either_way() -> None:
    lines = aged(year("sci", FALLING[:2], DAYS[:2]), KNOWN, Ageing())
    assert ageing.told(lines, HEADING, Ageing()) == f"{HEADING.title}: too few test sequences for an interval."
    (row, oracle) = ageing.table([one for one in lines if one.measure == HEADING], Ageing()).rows
    assert row == ("sci", "1.000", "−0.100", "–", "–", "−0.100", "–", "too few sequences")
    assert oracle[0] == ORACLE


def test_a_table_holds_the_line_of_each_method(made: tuple[Section, Path]) -> None:
    (caption, table) = made[0].tables[0]
    assert caption == "recall@1, training's heading, by cells, per 100 days"
    # Theil–Sen: slopes of pairs −.1 −.2 −.1 −.15 −.15 −.133 per 100 days, median −.1417
    assert table.rows[0] == ("sci", "1.010", "−0.140", "−0.201", "−0.079", "−0.142", "0.010", "72 [54, 117]")
    assert table.rows[1][0] == "m2dp"
    assert table.rows[1][-1] == "no ageing shown in 300"
    assert (table.rows[2][0], table.rows[2][-1]) == (ORACLE, "–")


def test_what_rises_is_no_ageing_but_of_novelty_it_is() -> None:
    lines = aged(year("sci", FALLING[::-1]), {}, Ageing())
    assert ageing.verdict(of(lines, "sci", AREA.key).line, AREA, 0.1) == "rises"
    novelty = next(measure for measure in MEASURES if measure.rises)
    up = replace(of(lines, "sci", AREA.key), measure=novelty)
    assert ageing.verdict(up.line, novelty, 0.1) == "yes"
    assert "look newer with the days to `sci` (+14.0 [+7.9, +20.1] per 100 days)" in ageing.newer(
        [replace(up, line=Ageing().line(up.days, 100 * up.values[:, 0]))]
    )


def test_what_differs_between_the_sequences_besides_their_age_is_said() -> None:
    # 2 of 7 queries are unseen, 1 of 5 seen ones drives the other way, in each sequence: nothing to correlate
    text = ageing.confounded(RESULTS)
    assert "unseen queries are 29 % of the first sequence and 29 % of the last, which" in text
    assert "another way than training are 20 % of the first sequence and 20 % of the last, which" in text


def test_sure_slopes_are_held_against_what_chance_would_give() -> None:
    # Recall, AUC and AUROC of both methods and novelty of the one whose held-out queries are known; sci falls twice
    assert "2 of 7 slopes surely mean ageing; were there none, about 0.2 would by chance." in ageing.counted(
        aged(RESULTS, KNOWN, Ageing()), Ageing()
    )


def test_mlflow_gets_the_slopes_their_intervals_and_the_day() -> None:
    told = series(RESULTS[:4], KNOWN, Ageing())
    assert told["ageing/cells_auc_top1_per_100_days"] == [(300, pytest.approx(-0.14))]
    assert told["ageing/cells_auc_top1_per_100_days_low"] == [(300, pytest.approx(-0.200849, rel=1e-5))]
    assert told["ageing/cells_auc_top1_retrain_after_days"] == [(300, pytest.approx(72.142857))]
    assert told["ageing/novelty_percentile"] == [(day, 75.0) for day in DAYS]
    assert not [name for name in told if "distance_auroc_retrain" in name or "novelty_percentile_retrain" in name]
    assert not [name for name in series(RESULTS[4:], {}, Ageing()) if "retrain" in name or "novelty" in name]


def test_figures_show_each_sequence_and_the_slope_bold_where_it_is_sure() -> None:
    fig = ageing_figures.lines(aged(RESULTS, KNOWN, Ageing()), simulated=False)
    panel = fig.axes[0]
    dots = next(line for line in panel.lines if line.get_marker() == "o")
    assert dots.get_xydata() == pytest.approx(np.stack([DAYS, FALLING], axis=1))
    weights = {text.get_text(): text.get_weight() for axis in fig.axes for text in axis.texts}
    assert weights["−0.140"] == "bold"
    assert weights["−0.005"] == "normal"
    slopes = ageing_figures.slopes(aged(RESULTS, KNOWN, Ageing()), simulated=False)
    assert [tick.get_text() for tick in slopes.axes[0].get_yticklabels()] == ["sci", "m2dp", "oracle"]


@pytest.mark.parametrize("draw", [ageing_figures.lines, ageing_figures.slopes])
def test_a_figure_is_honest_and_the_same_each_time_even_of_one_sequence(draw, tmp_path: Path) -> None:
    lines = aged(RESULTS[:1], {}, Ageing())
    for name in ("a", "b"):
        save(draw(lines, True), tmp_path / f"{name}.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    said = " ".join(text.get_text() for text in draw(lines, True).findobj(Text))
    assert SIMULATED in said
    assert re.search("by (cells|distance)", said)
