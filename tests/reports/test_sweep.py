"""The table and the figure of a sweep."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipeline.errors import InputError
from pipeline.reports import response
from pipeline.reports.sweep import Job, Sweep
from tests.reports.made import BROKEN, SWEEP, job, numbers


def draw(sweep: Sweep) -> Figure:
    return response.draw(sweep.jobs, sweep.swept(), sweep.simulated)


def test_only_what_differs_is_a_column() -> None:
    assert SWEEP.swept() == ("grid.cell_m", "method.n_way")
    assert SWEEP.fixed() == {"budget": "demo"}


def test_the_table_has_a_row_a_job_with_means_and_standard_deviations_and_says_which_failed() -> None:
    # The deviation of .7 and .5 with one degree of freedom is .2/√2 = .141; nothing has an AUROC.
    assert SWEEP.table().header[3:6] == ("AUC top-1 (cells)", "recall@1 (cells)", "recall@1 (distance)")
    assert SWEEP.table().rows == (
        ("0", "5", "1", "0.600 ± .141", "0.600 ± .141", "0.700 ± .141", "–", "3.0 ± 0.0", "0.610"),
        ("1", "5", "2", "0.700 ± .141", "0.600 ± .141", "0.700 ± .141", "–", "3.0 ± 0.0", "0.720"),
        ("2", "10", "1", "0.800 ± .141", "0.600 ± .141", "0.700 ± .141", "–", "3.0 ± 0.0", "0.800"),
        ("3", "10", "7", "–", "–", "–", "–", "–", "failed"),
    )
    assert SWEEP.failures() == ["job 3 failed: n_way=7: must divide 120"]


def test_held_out_blocks_choose_within_each_grid_since_grids_cannot_be_compared_by_cells() -> None:
    first, second = SWEEP.findings()
    assert first.startswith("Held-out blocks choose job 1 of grid.cell_m=5: method.n_way=2 (held-out AUC 0.720);")
    assert first.endswith("AUC top-1 0.700 by cells and recall@1 0.700 by distance.")
    assert second.startswith("Held-out blocks choose job 2 of grid.cell_m=10: method.n_way=1 (held-out AUC 0.800);")


def test_the_page_holds_the_table_the_failure_and_the_caveat(tmp_path: Path) -> None:
    SWEEP.write(tmp_path)
    page = (tmp_path / "sweep.md").read_text()
    assert "**Simulated, not recorded data.**" in page
    assert SWEEP.table().markdown() in page
    assert "- job 3 failed: n_way=7" in page
    assert "within one grid only" in page
    assert "![The sweep](sweep.svg)" in page
    assert (tmp_path / "sweep.txt").read_text() == SWEEP.text()
    assert SWEEP.text().startswith(
        "simulated campus: 4 jobs, budget=demo; means over 2 test sequences ± standard deviation\n\njob  "
    )


def test_the_figure_joins_means_over_the_first_numeric_parameter_with_most_values() -> None:
    fig = draw(Sweep([*SWEEP.jobs, job(4, "20", "2", 0.9, 0.8)], "campus", True))
    axis = fig.axes[0]
    assert [text.get_text() for text in axis.get_xticklabels()] == ["10", "5", "20"]  # where they come, at their numbers
    assert axis.get_xticks().tolist() == [10, 5, 20]
    labels = [text.get_text() for text in fig.legends[0].get_texts()]
    assert labels == ["n_way 1", "n_way 2", "n_way 7", "oracle recall@1"]
    one, two = (line for line in axis.lines if line.get_label() in ("n_way 1", "n_way 2"))
    assert one.get_xydata() == pytest.approx(np.array([[5, 0.6], [10, 0.8]]))
    assert two.get_xydata() == pytest.approx(np.array([[5, 0.7], [20, 0.8]]))
    (cross,) = (line for line in axis.lines if line.get_marker() == "x")
    assert cross.get_xdata() == [10]  # the job that failed
    assert fig.axes[1].get_ylabel() == "recall@1 by distance"


def test_words_are_not_joined_and_a_sweep_of_one_job_can_be_drawn() -> None:
    told = [Job(i, {"method.colormap": name}, {"a": numbers(0.5, 0.5)}) for i, name in enumerate(("jet", "grey"))]
    line = draw(Sweep(told, "nclt", False)).axes[0].lines[0]
    assert line.get_linestyle() == "None"
    assert line.get_xdata().tolist() == [0, 1]
    assert draw(Sweep(told[:1], "nclt", False)).axes[0].get_xlabel() == "job"


def test_a_sweep_in_which_all_failed_is_told_and_not_drawn(tmp_path: Path) -> None:
    failed = Sweep([BROKEN], "campus", True)
    failed.write(tmp_path)
    assert "job 3 failed" in (tmp_path / "sweep.txt").read_text()
    assert not (tmp_path / "sweep.svg").exists()
    with pytest.raises(InputError, match="nothing to draw"):
        draw(failed)
