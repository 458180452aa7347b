"""The view that MLflow's page opens on, read back as the page reads it."""

import base64
import json
import zlib
from typing import Any

import pytest

from pipeline.tracking import page
from pipeline.tracking.records import MEANS


@pytest.fixture(scope="module")
def view() -> Any:
    """Read a view as the page does: the envelope, then `deflate;` and base64 of zlib, then JSON."""
    envelope = json.loads(page.tags(page.YEAR)["mlflow.sharedViewState.yearloc"])
    assert isinstance(envelope["name"], str)
    assert isinstance(envelope["createdAt"], int)
    head, _, packed = envelope["state"].partition(";")
    assert head == "deflate"
    return json.loads(zlib.decompress(base64.b64decode(packed)))


def test_the_first_chart_is_what_is_accepted_over_days(view: Any) -> None:
    first = view["compareRunSections"][0]
    chart = next(
        chart for chart in view["compareRunCharts"] if chart["metricSectionId"] == first["uuid"]
    )
    expected = {
        "type": "LINE",
        "metricKey": "accepted/accepted",
        "xAxisKey": "step",
        "useGlobalXaxisKey": False,
    }
    assert chart.items() >= expected.items()


def test_the_table_of_runs_shows_data_sets_models_descriptions_and_means(view: Any) -> None:
    assert view["selectedColumns"] == view["columnOrder"] == [*view["columnWidths"]]
    assert [name for name in view["selectedColumns"] if name.startswith("attributes")] == [
        f"attributes.`{name}`" for name in ("Dataset", "Models", "Description")
    ]
    means = {f"metrics.`mean/{protocol}_{number}`" for protocol, number in MEANS}
    shown = {name for name in view["selectedColumns"] if name.startswith("metrics")}
    assert shown
    assert shown <= means


def test_every_chart_is_in_a_section_and_no_two_share_an_id(view: Any) -> None:
    sections, charts = (
        [one["uuid"] for one in view[kind]] for kind in ("compareRunSections", "compareRunCharts")
    )
    assert len(set(sections)) == len(sections)
    assert len(set(charts)) == len(charts)
    assert {chart["metricSectionId"] for chart in view["compareRunCharts"]} <= {*sections}


def test_all_runs_are_shown_in_the_order_of_their_start(view: Any) -> None:
    """The page nests children under parents only if it sorts by start, its default."""
    assert view["runsHiddenMode"] == "SHOW_ALL"
    assert "orderByKey" not in view


def test_mlflow_keeps_tags_of_this_length() -> None:
    for view in (page.YEAR, page.FURTHER_DAYS):
        assert all(len(value) <= 5_000 for value in page.tags(view).values())


def test_another_version_of_mlflow_opens_its_plain_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "version", lambda _: "4.0.1")
    assert {*page.tags(page.YEAR)} == {"mlflow.experimentKind", "mlflow.note.content"}
    assert "viewStateShareKey" not in page.url("3", "yearloc.localhost", 5000)


def test_the_address_opens_the_charts_of_the_view_and_not_the_assistant() -> None:
    url = page.url("3", "yearloc.localhost", 5000)
    assert url == (
        "http://yearloc.localhost:5000/#/experiments/3/runs"
        "?viewStateShareKey=yearloc&compareRunsMode=CHART&workflowType=machine_learning"
    )


@pytest.mark.parametrize(
    ("place", "count", "colour"),
    [(0, 1, "#440154"), (0, 5, "#440154"), (2, 5, "#21918c"), (4, 5, "#d8b000"), (1, 9, "#402a70")],
)
def test_children_are_shaded_from_first_to_last(place: int, count: int, colour: str) -> None:
    # (1, 9): halfway from (68, 1, 84) to (59, 82, 139) = (63.5, 41.5, 111.5), each half rounded to
    # even: 64, 42, 112
    assert page.shade(place, count) == colour
