"""A small built study, and a section beside it, for the tests of the page."""

import json
from pathlib import Path

import numpy as np

from pipeline import schemas, store
from pipeline.evaluation.judgement import summary
from pipeline.leaflet.page import Leaflet
from pipeline.reports.section import Section, Shown
from pipeline.reports.study import folders
from pipeline.reports.table import Table
from tests.reports.made import TRAIN_PLACES, TRAIN_XY_M, XY_M, evaluation

TRAIN, TESTS = "2012-01-15", {"2012-02-04": 20, "2012-03-17": 62}
LOOKS = {"sci": "scan_context", "m2dp": "m2dp"}
METHODS = [{"name": name, "view": view} for name, view in LOOKS.items()]
STUDIES = {
    "campus": {
        **{"world": "campus_tiny", "root": "artifacts/logs/campus", "heeds": "simulated", "question": "year"},
        **{"train": TRAIN, "tests": list(TESTS), "budget": "tiny", "submap": "single", "grids": ["10m"], "methods": METHODS},
        "robustness": {"turned": ["2012-02-04"], "broken": []},
    }
}
SVG = '<svg width="72pt" height="36pt" xmlns="http://www.w3.org/2000/svg"><path id="p" d="M0 0h72" stroke="#f00"/></svg>'
EVIL = 'a </script><script>window.evil = 1</script> & "b"'


def build(root: Path) -> Path:
    """The artifacts of one study with two methods and two test sequences."""
    find = folders(root, "campus", "10m", LOOKS)
    find("train", method="sci").parent.mkdir(parents=True)
    store.write_model(find("train", method="sci"), {"curves/loss": np.array([2.0, 1.0])}, {"epochs": 2, "budget": 0.1})
    store.write_model(find("train", method="m2dp"), {"descriptors": np.zeros((50, 192), np.float32)}, {"view": "m2dp"})
    for sequence, xy_m in ((TRAIN, TRAIN_XY_M), *((name, XY_M) for name in TESTS)):
        own = {"stamps_ns": np.arange(len(xy_m)), "world_T_anchor": poses(xy_m)}
        write(find("views", sequence, "sci"), schemas.VIEWS, images=heights(len(xy_m)), **own)
        write(find("views", sequence, "m2dp"), schemas.SIGNATURES, images=np.zeros((len(xy_m), 192), np.float32), **own)
    rows, own = np.arange(50), {"stamps_ns": np.arange(50), "world_T_anchor": poses(TRAIN_XY_M)}
    columns = {"first": rows, "scans": rows, "ground_m": np.zeros(50), "used": np.ones(50, bool), **own}
    write(find("submaps", TRAIN), schemas.SUBMAPS, {"layout": "world_T_scan", "left_out": {}}, **columns)
    zeros = dict.fromkeys(("nearest_m", "nearest_turn_deg"), np.zeros(50))
    attrs = {"days": 0, "cell_m": 10.0, "x_m": [0, 100], "y_m": [0, 10]}
    write(find("labels", TRAIN), schemas.LABELS, attrs, cells=np.arange(10), places=TRAIN_PLACES, oracle=TRAIN_PLACES, **zeros)
    told = {"wanted_precision": 0.9, "train": TRAIN, "bootstrap": {"resamples": 40}, "distance": {"correct_m": 12.0}}
    for method in LOOKS:
        numbers = {}
        for sequence, days in TESTS.items():
            one = evaluation(days, method=method)
            path, said = find("evaluate", sequence, method), {**one.attrs(), **told, "sequence": sequence}
            write(path, schemas.EVALUATIONS, said, **one.columns())
            numbers[sequence] = summary(one)
        find("metrics", method=method).write_text(json.dumps(numbers))
    return root


def drawn_and_told(root: Path) -> None:
    """One figure of the report, and one section."""
    figures, folder = root / "report/campus/10m", root / "robustness/campus/10m/turned"
    for place in (figures, folder):
        place.mkdir(parents=True)
    (figures / "year.svg").write_text(SVG)
    (folder / "turned.svg").write_text(SVG)
    table = Table(("method", "AUC"), (("sci", "0.810 ± .055"), ("m2dp", "–"), ("late", "0.90"), ("mean", "0.5")), words=1)
    Section(
        name="campus-10m-turned",
        title="Turned",
        question="Does it *matter*?",
        answer=(EVIL, EVIL),
        simulated=True,
        figures=(Shown("turned.svg", "How turned", "Read it so.", "It says so."),),
        tables=(("AUC by `case`", table), ("AUROC by `case`", table)),
        sources=("artifacts/robustness/campus/10m/turned/sci/2012-02-04.zarr",),
        parameters={"seed": 0},
    ).write(folder)


def leaflet(root: Path, lock: Path = Path("none.lock")) -> Leaflet:
    """The page's content."""
    return Leaflet.gather(root, STUDIES, "10m", lock)


def write(path: Path, schema: schemas.Schema, attrs: dict | None = None, **columns: np.ndarray) -> None:
    with store.write(path, schema, **(attrs or {})) as draft:
        for name, column in columns.items():
            draft.put(name, column)


def poses(xy_m: np.ndarray) -> np.ndarray:
    world_T_anchor = np.tile(np.eye(4), (len(xy_m), 1, 1))
    world_T_anchor[:, :2, 3] = xy_m
    return world_T_anchor


def heights(views: int) -> np.ndarray:
    return np.random.default_rng(views).uniform(0, 16, (views, 40, 120)).astype(np.float32)
