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


def test_sections_keep_the_order_given_and_charts_that_the_page_makes_itself_go_to_folded_ones(
    view: Any,
) -> None:
    """The page puts a metric that no chart names first into the section named like its prefix, in
    sight if it must make one."""
    assert view["isAccordionReordered"]
    shown = [section["name"] for section in view["compareRunSections"] if section["display"]]
    assert shown == [
        "Accepted answers, wrong ones among them, and wrong ones refused",
        "AUC over days since training",
        "Means over the test days",
        "By distance over days",
        "Rejection of unseen places over days",
        "Ageing: change per 100 days",
        "Ageing: novelty of the seen over days",
        "Heading of what is placed right over days",
        "Calibration error over days",
        "Training curves over epochs",
    ]
    folded = {section["name"] for section in view["compareRunSections"]} - {*shown}
    assert folded == {
        "accepted",
        "mean",
        "cells",
        "distance",
        "rejection",
        "ageing",
        "train",
        "viewpoints",
        "cost",
        "System metrics",
    } | {f"recall_by_{protocol}" for protocol in ("cells", "distance")}


def test_single_numbers_are_bars_over_the_runs_and_what_has_days_is_lines(view: Any) -> None:
    bars = {chart["metricKey"] for chart in view["compareRunCharts"] if chart["type"] == "BAR"}
    assert {name for name in bars if name.startswith("mean/")} == {
        "mean/cells_auc_top1",
        "mean/distance_recall_at_1",
    }
    assert all(name.startswith("mean/") or name.endswith("_per_100_days") for name in bars)
    lines = {chart["metricKey"] for chart in view["compareRunCharts"]} - bars
    assert not [
        name for name in lines if name.startswith("mean/") or name.endswith("_per_100_days")
    ]


def test_lines_have_the_whole_width_for_their_legend(view: Any) -> None:
    """A legend has two lines, whatever the chart's height."""
    wide = {section["uuid"]: section["columns"] for section in view["compareRunSections"]}
    assert {
        wide[chart["metricSectionId"]]
        for chart in view["compareRunCharts"]
        if chart["type"] == "LINE"
    } == {1}


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
