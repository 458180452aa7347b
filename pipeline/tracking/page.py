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

KEY = "yearloc"
LIMIT = 5_000  # characters that MLflow keeps of an experiment's tag
NOTE = (
    "Step: **days since training** (`train/`: epochs, `system/`: seconds). "
    "`cells/`: right if in the query's own cell, as the papers count; `distance/`: if near it.\n\n"
    "A method's run holds its whole year; unfold it for a run a day. Figures are in its artifacts. "
    "Where the side bar turns to GenAI, choose Model training above it, once.\n"
)
"""The first line shows above the charts, the rest once unfolded."""
SCALE = {"yMin": -0.02, "yMax": 1.02}
"""Of shares: a scale cut to the data would make a hundredth look like a season."""
COLOUR = "mlflow.runColor"  # the tag that fixes a run's colour in the charts, as #rrggbb
GREY = "#808080"
"""Of a run without a colour; MLflow would take one from the run's id, another one each time, and often the same for two."""
RAMP = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (216, 176, 0))
"""Viridis, its yellow darkened to be seen on white: the colours of children without one, from first to last."""


CHARTS = {
    "AUC over days since training": ("cells/auc_top1", "distance/auc_top1"),
    "Recall by distance over days": ("distance/recall_at_1", "distance/recall_at_5", "distance/recall_at_25"),
    "Rejection of unseen places over days": ("cells/auroc", "cells/recall_at_99_precision", "cells/precision_at_threshold"),
    "Ageing: how new the seen look over days, and change per 100 days": (
        "ageing/novelty_percentile",
        "ageing/cells_recall_at_1_same_heading_per_100_days",
        "ageing/cells_auc_top1_per_100_days",
    ),
    "Heading of what is placed right over days": ("distance/median_heading_error_deg", "distance/heading_within_10deg"),
    "Calibration error over days": ("calibration/ece", "calibration/ece_raw"),
    "Training curves over epochs": ("train/loss train/held_out_loss", "train/accuracy train/held_out_accuracy"),
}
"""Sections in sight: headline to its charts, side by side. A chart has a line a run and metric; blanks stand between metrics."""
UNBOUNDED = ("ageing/", "distance/median_heading_error_deg", "calibration/", "train/loss")
"""How the names of metrics begin that are not shares, or are too small ones to be seen on `SCALE`."""
FOLDED = ("cells", "distance", "rejection", "ageing", "train", "cost", "System metrics")
"""Sections below, for the charts that the page adds itself."""


def shade(place: int, count: int) -> str:
    """The colour of one of `count` runs that have none of their own, as #rrggbb: a step on the way along `RAMP`."""
    where = place / max(count - 1, 1) * (len(RAMP) - 1)
    before = min(int(where), len(RAMP) - 2)
    share = where - before
    return (
        "#" + bytes(round((1 - share) * low + share * high) for low, high in zip(*RAMP[before : before + 2], strict=True)).hex()
    )


def tags() -> dict[str, str]:
    """What an experiment is to be tagged with."""
    state = base64.b64encode(zlib.compress(json.dumps(_state(), separators=(",", ":")).encode(), 9)).decode()
    view = json.dumps({"name": "localisation over a year", "createdAt": 0, "state": f"deflate;{state}"})
    kind = "custom_model_development"  # else the page asks what kind of experiment this is
    return {"mlflow.experimentKind": kind, "mlflow.note.content": NOTE, f"mlflow.sharedViewState.{KEY}": view}


def url(experiment_id: str, host: str, port: int) -> str:
    """Where a browser sees the experiment's runs as charts, in the view above; MLflow 3 would else open elsewhere."""
    query = f"viewStateShareKey={KEY}&compareRunsMode=CHART&workflowType=machine_learning"
    return f"http://{host}:{port}/#/experiments/{experiment_id}/runs?{query}"


def _state() -> dict[str, object]:
    columns = {name: len(charts) for name, charts in CHARTS.items()} | dict.fromkeys(FOLDED, 3)
    sections = [
        {"uuid": name, "name": name, "display": name in CHARTS, "isReordered": False, "columns": wide}
        for name, wide in columns.items()
    ]
    charts = [_chart(section, chart.split()) for section, charts in CHARTS.items() for chart in charts]
    shown = {"isAccordionReordered": True, "runsHiddenMode": "SHOW_ALL"}
    return {"compareRunSections": sections, "compareRunCharts": charts, **shown}


def _chart(section: str, metrics: list[str]) -> dict[str, object]:
    """The page heads a chart with its metrics' names, and would take no title."""
    own = {"uuid": metrics[0], "type": "LINE", "metricSectionId": section, "metricKey": metrics[0]}
    axes = {"xAxisKey": "step", "xAxisScaleType": "linear", "scaleType": "linear", "yAxisKey": "metric", "yAxisExpressions": []}
    scale: dict[str, float] = {} if metrics[0].startswith(UNBOUNDED) else SCALE
    lines = {"displayPoints": True, "lineSmoothness": 0, "useGlobalXaxisKey": False, "useGlobalLineSmoothing": False}
    several = {"selectedMetricKeys": metrics} if len(metrics) > 1 else {}
    return {**own, **axes, "range": scale, **lines, **several}
