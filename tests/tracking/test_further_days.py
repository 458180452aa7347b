"""A study of learning further days has a run per strategy in MLflow, and a point per step."""

from pathlib import Path

import pytest

from pipeline.report import report
from pipeline.tracking import page
from pipeline.tracking.records import StudyRuns, of_strategies
from pipeline.tracking.runs import RunRecord
from tests.report import learned
from tests.report.studied import FEW


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunRecord]:
    study = learned.build(Path(tmp_path_factory.mktemp("learned"), "artifacts"))
    folder = study.layout.path("report")
    report.write(folder, study.layout, {"campus": learned.SETTINGS}, study.table, FEW, pytest.fail)
    return {
        one.name: one
        for one in of_strategies(
            StudyRuns(learned.SETTINGS, "10m", study.rows, folder / "campus/10m")
        )
    }


def test_a_run_is_a_strategy_and_a_point_the_mean_of_a_step(found: dict[str, RunRecord]) -> None:
    assert [name for name in found if name.startswith("sad")] == [
        "sad days frozen",
        "sad days incremental",
        "sad streets incremental",
    ]
    fine_tuned = found["sci days fine_tuned"]
    assert fine_tuned.series["cells/recall_of_all"] == [
        (0, 0.5),
        (1, 0.625),
    ]  # 2/4 and 3/4 of two seeds
    assert fine_tuned.series["recall_by_cells/2012-02-04"] == [(0, 0.5), (1, 0.25)]
    assert fine_tuned.series["cost/cpu_s"] == [(0, 100.0), (1, 2.0)]
    assert found["sci self_training self_trained_all"].series["cost/wrong"] == [(1, 3.5)]
    assert fine_tuned.params["seeds"] == 2
    assert fine_tuned.tags["data"] == "simulated"
    for said in (
        "the strategy `fine_tuned`",
        "**Simulated data**",
        "Steps: 2012-01-15, 2012-03-17.",
        "Means over 2 seeds",
    ):
        assert said in fine_tuned.about
    assert [(one.name, one.context) for one in fine_tuned.used][:2] == [
        ("campus 2012-01-15", "train"),
        ("campus 2012-03-17", "train"),
    ]


def test_a_strategy_has_one_colour_in_every_order_and_its_models_figures(
    found: dict[str, RunRecord],
) -> None:
    colours = {name.rpartition(" ")[2]: one.tags[page.COLOUR] for name, one in found.items()}
    assert all(
        one.tags[page.COLOUR] == colours[name.rpartition(" ")[2]] for name, one in found.items()
    )
    assert len({*colours.values()}) == len(colours)
    files = {path.name for path in found["sad days incremental"].figures}
    assert "lifelong_steps_sad.svg" in files
    assert "lifelong_steps_sci.svg" not in files


def test_the_page_shows_what_the_runs_have(found: dict[str, RunRecord]) -> None:
    shown = [
        name
        for one in page.FURTHER_DAYS["sections"].values()
        for chart in one["charts"]
        for name in chart.split()
    ]
    assert {*shown, *page.FURTHER_DAYS["metrics"]} <= found["sci days incremental"].series.keys()
