"""The study that was measured is kept beside its results, so that stale results are known."""

from pathlib import Path

import pytest

from pipeline.core.errors import ArtifactError
from pipeline.studies import measured
from pipeline.studies.layout import Layout
from tests.studies.made import study


def test_results_of_another_study_are_stale(tmp_path: Path) -> None:
    layout = Layout(tmp_path)
    campus = study(stress={"00": "all reversed"}, perturbed={"turned": ["2012-02-04"]})
    folder = layout.path("results", "campus")
    folder.mkdir(parents=True)
    assert measured.stale(layout, {"campus": campus}) == ["campus"]  # nothing says of which study
    measured.write(folder, campus)
    assert measured.read(layout, "campus") == campus
    assert measured.stale(layout, {"campus": campus}) == []
    longer = study(tests=["2012-02-04", "2012-10-28"])
    assert measured.stale(layout, {"campus": longer}) == ["campus"]


def test_without_results_no_study_was_measured(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"study\.yaml: no results yet; `dvc repro` gathers"):
        measured.read(Layout(tmp_path), "campus")
