"""A sweep of two cell sizes: its jobs reuse what DVC and other jobs built, and change nothing
else."""

import pandas as pd
import pytest

from pipeline.evaluation import results
from pipeline.evaluation.rows import table
from pipeline.studies.layout import Layout
from tests.clone import Clone
from tests.studies.made import study as made_study
from tests.swept import Swept, outcome


@pytest.fixture(scope="module")
def before(built: Clone) -> tuple[set[str], dict[str, str]]:
    """What is out of date, and the digests of all artifacts, before any sweep."""
    return built.outdated(), built.digests()


CELLS = ("grid.cell_m=5,10", "compute.workers=1")
"""Two sizes of cells; how many workers compute is no part of what a job builds."""


@pytest.fixture(scope="module")
def cells(built: Clone, before: object) -> Swept:
    return Swept(built, *CELLS)


def test_a_job_of_the_benchmarks_own_settings_is_dvcs_work(built: Clone, cells: Swept) -> None:
    assert cells.code == 0
    job = cells.jobs[1]
    assert job["built"] == job["from_sweeps"] == {}
    rows = results.read(Layout(built.folder / "artifacts"), {"campus": made_study()})
    rows = rows[(rows["model"] == "sci") & rows["ask"].isin(["unperturbed", "novelty"])]
    columns = ["sequence", "of", "protocol", "number"]
    values_of_job = table(job["rows"]).set_index(columns)["value"]
    values_of_dvc = rows.set_index(columns)["value"]
    assert len(values_of_job) > 100
    pd.testing.assert_series_equal(
        values_of_job, values_of_dvc.loc[values_of_job.index], rtol=1e-12
    )


def test_a_cell_size_costs_labels_models_and_what_follows(cells: Swept) -> None:
    assert set(cells.jobs[0]["built"]) == {"labels", "train", "localize", "evaluate"}
    assert cells.value(0, "seen") != cells.value(1, "seen")


def test_a_repeat_builds_nothing_and_says_the_same(built: Clone, cells: Swept) -> None:
    again = Swept(built, *CELLS)
    assert again.built == set()
    assert outcome(again) == outcome(cells)


def test_dvc_sees_nothing_of_a_sweep(built: Clone, cells: Swept, before: object) -> None:
    assert (built.outdated(), built.digests()) == before


def test_the_table_the_figure_and_mlflow_hold_every_job(built: Clone, cells: Swept) -> None:
    page = (cells.folder / "sweep.md").read_text()
    assert "grid.cell_m" in page
    assert "simulated" in page.lower()
    assert "simulated, not recorded" in (cells.folder / "sweep.svg").read_text()
    assert all(f"{sum(cells.value(job)) / 2:.3f}" in cells.out for job in (0, 1))
    assert "MLflow: 3 runs" in cells.out  # a parent and two jobs
