"""How MLflow's page of an experiment looks when it opens, and the texts on it.

In: a view, as templates/views.yaml describes it: which charts, in which order. Out: the tags of an
experiment (`tags`) and the address of its page (`url`) that make the page open so. A version of
MLflow that may not know such views gets neither, and opens its plain page.

MLflow 3 keeps a view of an experiment's page in the experiment's tag `mlflow.sharedViewState.KEY`,
and a page whose address says `viewStateShareKey=KEY` opens on it. The tag holds JSON `{"name",
"createdAt", "state"}`, its `state` being `deflate;` followed by the base64 of a zlib stream of
JSON, at most 5,000 characters in all. This was read in the page's own code of MLflow 3.17 and tried
there. Of the keys that the inner JSON may have, these are set:

- `compareRunSections`: `{"uuid", "name", "display", "isReordered"}` each, from top to bottom;
  `display`: unfolded. The page adds a chart of each metric that none of `compareRunCharts` shows to
  the section named like the metric's part before the slash (`System metrics` for `system/`, `Model
  metrics` for none), so a section of that name, folded, keeps them out of sight.
- `compareRunCharts`: `{"uuid", "type", "metricSectionId", "metricKey", …}` each, fields as MLflow's
  own configuration of a chart.
- `selectedColumns`, `columnOrder`, `columnWidths`: of the table of runs; the widths only count
  where the order is given too.
- `isAccordionReordered`: keeps the page from sorting the sections by name. `runsHiddenMode`: shows
  all runs, not the first ten.

Runs with children are folded on a page that opens so: unfolding (`runsExpanded`) is each reader's
own and cannot be shared.
"""

import base64
import json
import zlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from string import Template
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

KEY = "yearloc"
MAJOR = "3"  # the version of MLflow whose page knows such a view
# The y scale of metrics between 0 and 1. A scale cut to the data would make a change of a hundredth
# look large.
SCALE = {"yMin": -0.02, "yMax": 1.02}
COLOUR = "mlflow.runColor"  # the tag that fixes a run's colour in the charts, as #rrggbb
# The colour of a run without its own. MLflow would make one of the run's id, which is new each
# time, and often the same for two runs.
GREY = "#808080"
# The colours of children without their own, from first to last: viridis, its yellow darkened to be
# seen on white.
RAMP = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (216, 176, 0))
View = Mapping[str, Any]  # a view of templates/views.yaml
# The beginnings of names of metrics that SCALE does not fit: they do not lie between 0 and 1, or
# are too small to be seen on it.
UNBOUNDED = (
    "accepted/",
    "ageing/",
    "distance/median_heading_error_deg",
    "calibration/",
    "train/loss",
    "cost/",
    "cells/forgetting",
    "cells/transfer",
    "distance/forgetting",
    "distance/transfer",
)
# The sections below those of a view, which hold the charts that the page adds itself, and how many
# columns they have: one for lines, two for bars.
FOLDED = {
    "accepted": 1,
    "cells": 1,
    "distance": 1,
    "rejection": 1,
    "train": 1,
    "viewpoints": 1,
    "recall_by_cells": 1,
    "recall_by_distance": 1,
    "System metrics": 1,
    "mean": 2,
    "ageing": 2,
    "cost": 2,
}
# The columns of the table of runs beside a run's name and date, with their widths in px; the
# metrics of a view follow.
COLUMNS = {
    "attributes.`Dataset`": 290,
    "attributes.`Models`": 240,
    "attributes.`Description`": 120,
}


def part(name: str) -> str:
    """The text of a file in templates/."""
    return files("pipeline.tracking").joinpath("templates", name).read_text(encoding="utf-8")


YEAR, FURTHER_DAYS = yaml.safe_load(part("views.yaml")).values()


def filled(name: str, **values: Any) -> str:
    """A filled template; its `$page` waits for `linked`."""
    return _environment().get_template(name).render(**values)


def linked(text: str, experiment_id: str) -> str:
    """A text with `$page` replaced by the address of the experiment's charts.

    Only the database knows that address.
    """
    return Template(text).safe_substitute(page=fragment(experiment_id))


@cache
def _environment() -> Environment:
    loader = PackageLoader("pipeline.tracking", "templates")
    return Environment(loader=loader, undefined=StrictUndefined, autoescape=False)


def shade(place: int, count: int) -> str:
    """The colour on RAMP of the child at index `place` of `count` children, as #rrggbb."""
    position = place / max(count - 1, 1) * (len(RAMP) - 1)
    before = min(int(position), len(RAMP) - 2)
    fraction = position - before  # of the way to the next colour
    channels = zip(RAMP[before], RAMP[before + 1], strict=True)
    mixed = [round((1 - fraction) * low + fraction * high) for low, high in channels]
    return f"#{bytes(mixed).hex()}"


def tags(view: View) -> dict[str, str]:
    """The tags of an experiment that shows this view, or MLflow's plain page if it knows none."""
    tags = {
        # else the page asks what kind of experiment this is
        "mlflow.experimentKind": "custom_model_development",
        "mlflow.note.content": part("experiment.md"),
    }
    if _knows_views():
        text = json.dumps(_state(view), separators=(",", ":"))
        state = base64.b64encode(zlib.compress(text.encode(), 9)).decode()
        packed = {"name": view["name"], "createdAt": 0, "state": f"deflate;{state}"}
        tags[f"mlflow.sharedViewState.{KEY}"] = json.dumps(packed)
    return tags


def fragment(experiment_id: str) -> str:
    """The end of the address at which the page opens as charts, on the view that `tags` gives."""
    view = f"viewStateShareKey={KEY}&" if _knows_views() else ""
    query = f"{view}compareRunsMode=CHART&workflowType=machine_learning"
    return f"#/experiments/{experiment_id}/runs?{query}"


def _knows_views() -> bool:
    return version("mlflow").partition(".")[0] == MAJOR


def url(experiment_id: str, host: str, port: int) -> str:
    """The address at which a browser shows the experiment's runs as charts."""
    return f"http://{host}:{port}/{fragment(experiment_id)}"


def _state(view: View) -> dict[str, object]:
    """The state of the experiment's page, with the keys that the module's docstring lists."""
    widths = COLUMNS | {f"metrics.`{name}`": width for name, width in view["metrics"].items()}
    unfolded = [
        _section(
            name,
            is_unfolded=True,
            columns=section.get("columns", 1),
            cardHeight=section.get("height", 320),
        )
        for name, section in view["sections"].items()
    ]
    folded = [
        _section(name, is_unfolded=False, columns=columns) for name, columns in FOLDED.items()
    ]
    return {
        "compareRunSections": unfolded + folded,
        "compareRunCharts": [
            _chart(name, metrics.split(), section.get("bars", False))
            for name, section in view["sections"].items()
            for metrics in section["charts"]
        ],
        "isAccordionReordered": True,
        "runsHiddenMode": "SHOW_ALL",
        "selectedColumns": [*widths],
        "columnOrder": [*widths],
        "columnWidths": widths,
    }


def _section(name: str, is_unfolded: bool, **size: int) -> dict[str, object]:
    """A section of charts; `size` is its number of columns, and the height of a chart in px."""
    return {"uuid": name, "name": name, "display": is_unfolded, "isReordered": False, **size}


def _chart(section: str, metrics: list[str], bars: bool) -> dict[str, object]:
    """A chart, as the page's own configuration has it."""
    chart = {"uuid": metrics[0], "metricSectionId": section, "metricKey": metrics[0]}
    if bars:
        return {**chart, "type": "BAR"}
    several = {"selectedMetricKeys": metrics} if len(metrics) > 1 else {}
    return {
        **chart,
        "type": "LINE",
        "xAxisKey": "step",
        "xAxisScaleType": "linear",
        "scaleType": "linear",
        "yAxisKey": "metric",
        "yAxisExpressions": [],
        "range": {} if metrics[0].startswith(UNBOUNDED) else SCALE,
        "displayPoints": True,
        "lineSmoothness": 0,
        "useGlobalXaxisKey": False,
        "useGlobalLineSmoothing": False,
        **several,
    }
