"""How MLflow's page looks when it opens: which charts, in which order, over which axis.

MLflow 3 keeps a view of an experiment's page in the experiment's tag `mlflow.sharedViewState.KEY`, and a page whose address says
`viewStateShareKey=KEY` opens on it. The tag holds JSON `{"name", "createdAt", "state"}`, its `state` being `deflate;` followed by
the base64 of a zlib stream of JSON, at most 5,000 characters in all. So read in the page's own code of MLflow 3.17 and tried
there; of the keys that the inner JSON may have, these are set:

- `compareRunSections`: `{"uuid", "name", "display", "isReordered"}` each, from top to bottom; `display`: unfolded. The page adds
  a chart of each metric that none of `compareRunCharts` shows to the section named like the metric's part before the slash
  (`System metrics` for `system/`, `Model metrics` for none), so a section of that name, folded, keeps them out of sight.
- `compareRunCharts`: `{"uuid", "type", "metricSectionId", "metricKey", …}` each, fields as MLflow's own configuration of a chart.
- `isAccordionReordered`: the page shall not sort the sections by name. `runsHiddenMode`: show all runs, not the first ten.

Runs with children are folded on a page that opens so: unfolding (`runsExpanded`) is each reader's own and cannot be shared.
"""

import base64
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

KEY = "yearloc"
TAG = f"mlflow.sharedViewState.{KEY}"
NAME = "localisation over a year"
"""How the page's menu of saved views calls it."""
LIMIT = 5_000
"""Characters that MLflow keeps of an experiment's tag."""
KIND = "custom_model_development"
"""Else the page asks what kind of experiment this is."""
NOTE = (
    "Step: **days since training** (`train/`: epochs, `system/`: seconds). "
    "`cells/`: right if in the query's own cell, as the papers count; `distance/`: if near it.\n\n"
    "A method's run holds its whole year; unfold it for a run a day. Figures are in its artifacts. "
    "Where the side bar turns to GenAI, choose Model training above it, once.\n"
)
"""The first line shows above the charts, the rest once unfolded."""
SCALE = {"yMin": -0.02, "yMax": 1.02}
"""Of shares: a scale cut to the data would make a hundredth look like a season."""
COLOUR = "mlflow.runColor"
"""The tag that fixes a run's colour in the charts, as #rrggbb."""
GREY = "#808080"
"""Of a run without a colour; MLflow would take one from the run's id, another one each time, and often the same for two."""
RAMP = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (216, 176, 0))
"""Viridis, its yellow darkened to be seen on white: the colours of children without one, from first to last."""


@dataclass(frozen=True)
class Chart:
    """A line a run and metric over the metric's steps. The page heads it with the metrics' names, and would take no title."""

    metrics: tuple[str, ...]
    share: bool = True
    """On the scale from 0 to 1."""


@dataclass(frozen=True)
class Section:
    """Charts under one headline."""

    name: str
    charts: tuple[Chart, ...] = ()
    unfolded: bool = False
    columns: int = 3


SECTIONS = (
    Section(
        "AUC over days since training",
        (Chart(("cells/auc_top1",)), Chart(("distance/auc_top1",))),
        unfolded=True,
        columns=2,
    ),
    Section(
        "Recall by distance over days",
        (Chart(("distance/recall_at_1",)), Chart(("distance/recall_at_5",)), Chart(("distance/recall_at_25",))),
        unfolded=True,
    ),
    Section(
        "Rejection of unseen places over days",
        (Chart(("cells/auroc",)), Chart(("cells/recall_at_99_precision",)), Chart(("cells/precision_at_threshold",))),
        unfolded=True,
    ),
    Section(
        "Ageing: how new the seen look over days, and change per 100 days",
        tuple(
            Chart((f"ageing/{name}",), share=False)
            for name in ("novelty_percentile", "cells_recall_at_1_same_heading_per_100_days", "cells_auc_top1_per_100_days")
        ),
        unfolded=True,
    ),
    Section(
        "Heading of what is placed right over days",
        (Chart(("distance/median_heading_error_deg",), share=False), Chart(("distance/heading_within_10deg",))),
        unfolded=True,
        columns=2,
    ),
    Section(
        "Calibration error over days",
        (Chart(("calibration/ece",), share=False), Chart(("calibration/ece_raw",), share=False)),
        unfolded=True,
        columns=2,
    ),
    Section(
        "Training curves over epochs",
        (Chart(("train/loss", "train/held_out_loss"), share=False), Chart(("train/accuracy", "train/held_out_accuracy"))),
        unfolded=True,
        columns=2,
    ),
    *(Section(prefix) for prefix in ("cells", "distance", "rejection", "ageing", "train", "cost", "System metrics")),
)


def shade(place: int, count: int) -> str:
    """The colour of one of `count` runs that have none of their own, as #rrggbb: a step on the way along `RAMP`."""
    where = place / max(count - 1, 1) * (len(RAMP) - 1)
    before = min(int(where), len(RAMP) - 2)
    share = where - before
    mixed = [round((1 - share) * low + share * high) for low, high in zip(RAMP[before], RAMP[before + 1], strict=True)]
    return "#" + bytes(mixed).hex()


def tags() -> dict[str, str]:
    """What an experiment is to be tagged with."""
    return {"mlflow.experimentKind": KIND, "mlflow.note.content": NOTE, TAG: view()}


def view() -> str:
    """The value of the tag `TAG`."""
    state = base64.b64encode(zlib.compress(json.dumps(_state(), separators=(",", ":")).encode(), 9)).decode()
    return json.dumps({"name": NAME, "createdAt": 0, "state": f"deflate;{state}"})


def url(experiment_id: str, host: str, port: int) -> str:
    """Where a browser sees the experiment's runs as charts, in the view above; MLflow 3 would else open elsewhere."""
    query = f"viewStateShareKey={KEY}&compareRunsMode=CHART&workflowType=machine_learning"
    return f"http://{host}:{port}/#/experiments/{experiment_id}/runs?{query}"


def _state() -> dict[str, object]:
    sections = [
        {
            "uuid": section.name,
            "name": section.name,
            "display": section.unfolded,
            "isReordered": False,
            "columns": section.columns,
        }
        for section in SECTIONS
    ]
    return {
        "compareRunSections": sections,
        "compareRunCharts": [chart for section in SECTIONS for chart in _charts(section)],
        "isAccordionReordered": True,
        "runsHiddenMode": "SHOW_ALL",
    }


def _charts(section: Section) -> Iterator[dict[str, object]]:
    for chart in section.charts:
        several = {"selectedMetricKeys": list(chart.metrics)} if len(chart.metrics) > 1 else {}
        yield {
            "uuid": chart.metrics[0],
            "type": "LINE",
            "metricSectionId": section.name,
            "metricKey": chart.metrics[0],
            "xAxisKey": "step",
            "xAxisScaleType": "linear",
            "scaleType": "linear",
            "yAxisKey": "metric",
            "yAxisExpressions": [],
            "range": SCALE if chart.share else {},
            "displayPoints": True,
            "lineSmoothness": 0,
            "useGlobalXaxisKey": False,
            "useGlobalLineSmoothing": False,
            **several,
        }
