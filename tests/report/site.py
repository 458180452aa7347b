"""A small study and its sections, for the tests of the page: seven queries on two days, two models, some figures and tables."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pipeline import schemas, store
from pipeline.evaluation.protocols import Distance
from pipeline.report.findings import Finding
from pipeline.report.section import Illustration, Section
from pipeline.report.table import MISSING, Cell, Table, number, word

TRAIN, TESTS = "2012-01-15", {"2012-02-04": 20, "2012-03-17": 62}
LOOKS = {"sci": ("scan_context", schemas.VIEWS), "m2dp": ("m2dp", schemas.SIGNATURES)}
XY_M = np.array([(0, 0), (10, 0), (10, 0), (30, 0), (40, 0), (40, 100), (40, 120)], float)
"""Queries 1 and 2 lie on each other: one is placed right, the other 200 m off."""
PATH_XY_M = np.stack([np.linspace(0, 100, 50), np.zeros(50)], axis=1)
SVG = '<svg width="72pt" height="36pt" xmlns="http://www.w3.org/2000/svg"><path id="p" d="M0 0h72" stroke="#f00"/></svg>'
EVIL = 'a </script><script>window.evil = 1</script> & "b"'
WORDS: dict[str, Any] = {
    "findings": {"answer": "`sci` is right for {{ share }}", "plain": "{{ text }}"},
    "sections": {"turned": {"title": "Turned <headings>", "question": "Does it *matter*?"}, "setup": {"title": "In {{ study }}"}},
    "figures": {"how": {"title": "How turned", "read": "Read it so."}},
    "tables": {"auc": "AUC by `case`", "auroc": "AUROC by `case`"},
}


def evaluation(answers_xy_m: np.ndarray, seen: np.ndarray) -> SimpleNamespace:
    """By distance within 12 m; by cells the fourth answer is wrong as well, as it lies in the next cell."""
    distance = SimpleNamespace(outcome=np.array([0, 0, 2, 0, 0, 2, 3]), true_rank=np.array([0, 0, -1, 0, 0, -1, -1]), seen=seen)
    cells = SimpleNamespace(outcome=np.array([0, 1, 2, 2, 0, 2, 3]), true_rank=np.array([0, 0, -1, 1, 0, -1, -1]), seen=seen)
    novelty = np.array([[0.1], [0.3], [0.2], [0.3], [0.05], [0.4], [0.9]])
    nearest_m, nan = np.where(seen, 1.0, 100.0), np.full(7, np.nan)
    queries = {"xy_m": XY_M, "answer_xy_m": answers_xy_m, "nearest_m": nearest_m, "novelty": novelty, "heading_error_deg": nan}
    return SimpleNamespace(distance=distance, cells=cells, **queries, kinds=("entropy",), reject_from=(0.5,))


def study(root: Path, path_xy_m: np.ndarray = PATH_XY_M) -> Any:
    """The views alone lie on the disk, under `root`."""

    def find(kind: str, sequence: str = "", model: str = "") -> Path:
        within = {"views": LOOKS.get(model, ("",))[0], "train": "10m", "labels": "10m"}.get(kind, f"10m/{model}")
        return root / kind / "campus" / within / (f"{sequence}.zarr" if sequence else f"{model}.safetensors")

    answers_xy_m = XY_M + np.array([(1, 0), (1, 0), (200, 0), (6, 0), (1, 0), (1, 0), (1, 0)])
    given, seen = evaluation(answers_xy_m, np.arange(7) < 5), root / "views" / "campus"
    tests = [{"sequence": day, "days": days} for day, days in TESTS.items()]
    results = [SimpleNamespace(model=model, evaluation=given, **test) for model in LOOKS for test in tests]
    for view, schema in LOOKS.values() if not seen.exists() else ():
        for day, rows in ((TRAIN, 50), *((day, 7) for day in TESTS)):
            images = heights(rows) if schema is schemas.VIEWS else np.zeros((rows, 192), np.float32)
            with store.write(seen / view / f"{day}.zarr", schema) as draft:
                columns = {"images": images, "stamps_ns": np.arange(rows), "world_T_anchor": np.tile(np.eye(4), (rows, 1, 1))}
                for name, column in columns.items():
                    draft.put(name, column)
    models = {"sci": SimpleNamespace(recipe={"epochs": "2", "_target_": "Sci"}), "m2dp": SimpleNamespace(recipe={})}
    known: dict[str, Any] = {"name": "campus", "dataset": "campus", "grid": "10m", "cell_m": 10.0, "simulated": True}
    known |= {"train": TRAIN, "best": "sci", "distance": Distance(correct_m=12.0), "train_xy_m": path_xy_m}
    return SimpleNamespace(**known, results=results, models=models, find=find)


def heights(views: int) -> np.ndarray:
    """Scan Contexts of noise."""
    return np.random.default_rng(views).uniform(0, 16, (views, 40, 120)).astype(np.float32)


def sections(root: Path) -> list[Section]:
    """An answer, a set-up, and a study with two figures, of which one is lost, and two tables."""
    (root / "turned.svg").write_text(SVG)
    source = f"{root}/evaluate/campus/10m/sci/2012-02-04.zarr"
    cells = {
        "sci": number(0.81, 3, (0.7, 0.9), "+", source),
        "m2dp": Cell(MISSING),
        "late <b>": number(10.9, 2),
        "mean": number(1, 1),
    }
    rows = tuple((word(name), cell) for name, cell in cells.items())
    tables = tuple(Table(kind, ("method", "AUC"), rows, mean=True) for kind in ("auc", "auroc"))
    says = Finding("plain", {"text": EVIL})
    figures = (Illustration("how", root / "turned.svg", findings=(says,)), Illustration("how", root / "lost.svg"))
    own = {"sources": ("artifacts/turned.zarr",), "parameters": {"seed": 0, "trained with": {"sci": [1, 2]}}}
    return [
        Section("campus-10m-answer", "answer", "answer", findings=(Finding("answer", {"share": "80 %"}),)),
        Section("campus-10m-setup", "setup", "setup", {"study": EVIL}),
        Section("campus-10m-turned", "turned", "studies", findings=(says, says), illustrations=figures, tables=tables, **own),
    ]


class Lock:
    """Knows the models alone."""

    def of(self, path: str) -> tuple[str, str]:
        return ("0a1b", "train@campus") if "/train/" in path else ("", "")

    def params(self, stage: str) -> dict[str, Any]:
        return {"conf/lists.yaml": {"campus": 1}, "conf/train.yaml": {"seed": 7}}
