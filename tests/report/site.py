"""A small study and its sections, for the tests of the page: seven queries on two days, two models,
some figures and tables.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pipeline.core.schemas import Submaps
from pipeline.report.findings import Finding
from pipeline.report.section import Illustration, Section
from pipeline.report.study import StudyResults
from pipeline.report.table import MISSING, Cell, Table, number
from pipeline.report.web.front import front
from pipeline.report.web.page import Entry
from tests.artifacts import write_scans
from tests.report import studied
from tests.studies.made import study as made_study

TRAIN = ("2012-01-15", "2012-01-22")
TESTS = ("2012-02-04", "2012-06-15")
SETTINGS = made_study(
    train=" ".join(TRAIN),
    tests=list(TESTS),
    methods=[
        {"name": "m2dp", "view": "signature"},
        {"name": "sci", "view": "scan_context"},
    ],
    perturbed={"turned": [TESTS[0]]},
)
XY_M = np.array([(0, 0), (10, 0), (10, 0), (30, 0), (40, 0), (40, 100), (40, 120)], float)
"""Queries 2 and 3 of 7 lie on each other: one is placed right, the other 200 m off."""
WALL_M = np.stack([np.arange(-5, 5, 0.25), np.full(40, 10.0), np.full(40, 2.0)], axis=1)
SVG = '<svg width="72pt" height="36pt" xmlns="http://www.w3.org/2000/svg"><path id="p" d="M0 0h72" stroke="#f00"/></svg>'
EVIL = 'a </script><script>window.evil = 1</script> & "b"'
WORDS: dict[str, Any] = {
    "findings": {"plain": "{{ text }}"},
    "sections": {"turned": "Turned <headings>\nDoes it *matter*?", "setup": "In {{ study }}"},
    "figures": {"how": "How turned\nRead it so."},
    "tables": {"auc": "AUC by `case`", "auroc": "AUROC by `case`"},
}


def build(artifacts: Path) -> StudyResults:
    """The study, whose scans see a wall 10 m to their left each."""
    study = studied.build(artifacts, SETTINGS, XY_M, 3, validation_precision=(0.731, np.nan))
    for day in (*TRAIN, *TESTS):
        poses = study.artifact(Submaps, "submaps", day).world_T_anchor
        write_scans(study.find("scans", day), [WALL_M] * len(poses), poses)
    return study


def heights(views: int) -> np.ndarray:
    """Scan Contexts of noise."""
    return np.random.default_rng(views).uniform(0, 16, (views, 40, 120)).astype(np.float32)


def entries(study: StudyResults) -> list[Entry]:
    """The study as the page takes it."""
    return [Entry(study, sections(study.layout.root), front(study))]


def sections(root: Path) -> list[Section]:
    """A set-up, and a study with two figures, of which one is lost, and two tables."""
    (root / "turned.svg").write_text(SVG)
    numbers = (
        number(0.81, 3, (0.7, 0.9), "+"),
        Cell(MISSING),
        number(10.9, 2),
        number(1, 1),
    )
    rows = tuple(
        (Cell(name), cell)
        for name, cell in zip(("sci", "m2dp", "late <b>", "mean"), numbers, strict=True)
    )
    tables = tuple(
        Table(kind, ("method", "AUC"), rows, has_footer=True) for kind in ("auc", "auroc")
    )
    says = Finding("plain", text=EVIL)
    figures = (
        Illustration("how", root / "turned.svg", findings=(says,)),
        Illustration("how", root / "lost.svg"),
    )
    own = {
        "sources": ("artifacts/turned.zarr",),
        "parameters": {"seed": 0, "trained with": {"sci": [1, 2]}},
    }
    return [
        Section("campus-10m-setup", "setup", {"study": EVIL}),
        Section(
            "campus-10m-turned",
            "turned",
            findings=(says, says),
            illustrations=figures,
            tables=tables,
            **own,
        ),
    ]


LOCK: Any = SimpleNamespace(
    of=lambda path: ("0a1b", "train@campus") if "/train/" in path else ("", ""),
    params=lambda stage: {"conf/lists.yaml": {"campus": 1}, "conf/train.yaml": {"seed": 7}},
)
"""Knows the models alone."""
