"""A site of three places, 200 m apart, in each of which another made-up scene stands."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.grid import Grid
from pipeline.core.progress import Progress
from pipeline.core.settings import filled
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.matching.places import label
from pipeline.matching.ranking import Rows
from pipeline.methods.scan_context import ScanContext50
from pipeline.online import site_file
from pipeline.online.site_json import VERSION, SiteDescription
from pipeline.posing.expectations import Expectations
from pipeline.posing.verdict import CLAIMS
from pipeline.views.scan_context import ScanContext
from tests.posing.scene import planar, scene, seen_from

ANCHORS = np.array([planar(0, 0, 0), planar(200, 0, 90), planar(400, 0, -30)])
GRID = Grid(10.0, (-5.0, 415.0), (-5.0, 15.0))
SENSOR = {
    "lift_m": 0.0,
    "points": 14800.0,
    "azimuth_deg": 360.0,
    "beams": None,
    "ground_m": 0.0,
    "sensor_m": None,
}
READER = {"_target_": "pipeline.readers.nclt.Nclt"}


def described(**changes: Any) -> SiteDescription:
    """The description of the site, as it is read from JSON; `changes` replace some of its keys."""
    return filled(SiteDescription, about(**changes))


def about(**changes: Any) -> dict[str, Any]:
    """The content of the site's site.json; `changes` replace some of its keys.

    A fix is right with a probability of .98 at an overlap of .8, of .02 at one of .4; a probability
    of .9 keeps a target precision of .99. The robot is surely near it from an overlap of .4 on.
    """
    verdict = {
        "pose": {"weights": (20.0, *5 * (0.0,)), "offset": -12.0},
        "place": {"weights": (200.0, *5 * (0.0,)), "offset": -70.0},
        "target_precisions": (0.95, 0.99, 0.999),
        "claim_thresholds": dict.fromkeys(CLAIMS, (0.5, 0.1, -1.0)),
    }
    usual = {
        "version": VERSION,
        "name": "three/10m/scan_context",
        "simulated": True,
        "method": {"_target_": "pipeline.methods.scan_context.ScanContext50", "candidates": 3},
        "view": {"_target_": "pipeline.views.scan_context.ScanContext"},
        "fixer": {"_target_": "pipeline.posing.search.Fixer"},
        "k": 3,
        "places": {"cell_m": GRID.cell_m, "x_m": GRID.x_m, "y_m": GRID.y_m},
        "map": {"grain_m": GRAIN_M, "range_m": 80.0, "single": True},
        "verdict": verdict | {"validation_blocks": 100, "unseen_share": 0.2},
        "reader": READER,
        "sensor": SENSOR | {"warnings": []},
        "provenance": {"train": "monday", "md5": {"model": "0" * 32}, "versions": {"yearloc": "0"}},
    }
    return usual | changes


def arrays() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The arrays of the model and of the map."""
    clouds = [scene(seed) for seed in range(3)]
    labels = label(ANCHORS, ANCHORS, GRID, 0)
    views = Rows(np.stack([ScanContext()(cloud) for cloud in clouds]), np.arange(3), ANCHORS)
    model = ScanContext50(candidates=3).learn(views, labels.places, Progress())
    points = np.rint(np.concatenate(clouds) / GRAIN_M).astype(np.int64)
    offsets = np.cumsum([0, *map(len, clouds)])
    return dict(model), {
        "points": points,
        "offsets": offsets,
        "world_T_anchor": ANCHORS,
        "cells": labels.cells,
        **Expectations().arrays,
    }


def packed(folder: Path, **changes: Any) -> Path:
    """Write the site's file; `changes` replace some keys of its site.json."""
    return with_content(folder / "three.site", about(**changes))


def with_content(path: Path, content: dict[str, Any]) -> Path:
    """Write the site's file with this site.json, be it valid or not."""
    site_file.write(path, site_file.Parts(described(), *arrays(), None))
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    members[site_file.ABOUT] = json.dumps(content, indent=1).encode()
    with zipfile.ZipFile(path, "w") as file:
        for name, data in members.items():
            file.writestr(zipfile.ZipInfo(name, site_file.EPOCH), data, zipfile.ZIP_DEFLATED, 6)
    return path


def scan(
    row: int = 1, x_m: float = -3.0, y_m: float = 4.0, yaw_deg: float = 40.0
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) seen in place `row`, from so far off its anchor, and the true pose (4, 4)."""
    anchor_T_robot = planar(x_m, y_m, yaw_deg)
    return seen_from(scene(row), anchor_T_robot), ANCHORS[row] @ anchor_T_robot
