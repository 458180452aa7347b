"""A small fake study and its sections, for the tests of the page: seven queries on two days, two
models, some figures and tables.

`study` has the fields of `pipeline.report.study.Study` that the page reads; `entries` is that study
as the page takes it.
"""

from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core import schemas
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.protocols import Distance
from pipeline.evaluation.rows import PERTURBED, UNPERTURBED, pick, row, table
from pipeline.mapping.from_above import Drive, Footprint, along
from pipeline.report.findings import Finding
from pipeline.report.result import Result
from pipeline.report.section import Illustration, Section
from pipeline.report.table import MISSING, Cell, Table, number
from pipeline.report.web.front import front
from pipeline.report.web.page import Entry
from tests.artifacts import write_views
from tests.studies.made import study as made_study
from tests.views.made import artifacts

TRAIN = ("2012-01-15", "2012-01-22")
TESTS = {"2012-02-04": 20, "2012-03-17": 62}
LOOKS = {"m2dp": schemas.SignatureViews, "sci": schemas.ScanContextViews}
XY_M = np.array([(0, 0), (10, 0), (10, 0), (30, 0), (40, 0), (40, 100), (40, 120)], float)
"""Queries 2 and 3 of 7 lie on each other: one is placed right, the other 200 m off."""
ANSWERS_XY_M = XY_M + np.array([(1, 0), (1, 0), (200, 0), (6, 0), (1, 0), (1, 0), (1, 0)])
PATH_XY_M = np.stack([np.linspace(100, 0, 50), np.zeros(50)], axis=1)
"""Training drove it on two days, 25 submaps each."""
WALL_M = np.stack([np.arange(-5, 5, 0.25), np.full(40, 10.0), np.full(40, 2.0)], axis=1)
SVG = '<svg width="72pt" height="36pt" xmlns="http://www.w3.org/2000/svg"><path id="p" d="M0 0h72" stroke="#f00"/></svg>'
EVIL = 'a </script><script>window.evil = 1</script> & "b"'
WORDS: dict[str, Any] = {
    "findings": {"plain": "{{ text }}"},
    "sections": {"turned": "Turned <headings>\nDoes it *matter*?", "setup": "In {{ study }}"},
    "figures": {"how": "How turned\nRead it so."},
    "tables": {"auc": "AUC by `case`", "auroc": "AUROC by `case`"},
}


def evaluation() -> SimpleNamespace:
    """By distance within 12 m; by cells the fourth answer is wrong as well, as it lies in the next
    cell."""
    seen = np.arange(7) < 5
    novelty = np.array([[0.1, 0.3, 0.2, 0.3, 0.05, 0.4, 0.9]]).T
    distance = SimpleNamespace(
        outcome=np.array([0, 0, 2, 0, 0, 2, 3]),
        true_rank=np.array([0, 0, -1, 0, 0, -1, -1]),
        seen=seen,
    )
    cells = SimpleNamespace(
        outcome=np.array([0, 1, 2, 2, 0, 2, 3]),
        true_rank=np.array([0, 0, -1, 1, 0, -1, -1]),
        seen=seen,
    )
    distance.recall_at = np.array([0.6, 0.8])
    shown = {
        "xy_m": XY_M,
        "answer_xy_m": ANSWERS_XY_M.copy(),
        "nearest_m": np.where(seen, 1.0, 100.0),
    }
    return SimpleNamespace(
        distance=distance,
        cells=cells,
        novelty=novelty,
        kinds=("entropy",),
        reject_from=(0.5,),
        kept_precision=(0.731,),
        right_within=(2.0, 5.0),
        reject_pose_from=np.nan,
        acceptance={
            "accepted": np.arange(7) < 6,
            "accepted_wrong": np.isin(np.arange(7), (2, 5)),
            "refused": np.arange(7) == 6,
            "refused_wrong": np.arange(7) == 6,
        },
        **shown,
    )


def study(root: Path, path_xy_m: np.ndarray = PATH_XY_M) -> Any:
    """The fake study; its views, scans and submaps lie on the disk, under `root`."""

    def find(kind: str, sequence: str = "", model: str = "") -> Path:
        return (
            root
            / kind
            / "campus"
            / (f"{model}/{sequence}.zarr" if sequence else f"{model}.zarr.zip")
        )

    tests = [{"sequence": day, "days": days} for day, days in TESTS.items()]
    given = evaluation()
    driven = pick(results_table(), ask=UNPERTURBED)
    results = [
        Result(model, **test, evaluation=given, rows=pick(driven, method=model, **test))
        for model in LOOKS
        for test in tests
    ]
    for model, day in product(LOOKS, (*TRAIN, *TESTS)) if not (root / "views").exists() else ():
        rows = 25 if day in TRAIN else 7
        if not (root / "drives" / day).exists():
            drive(root / "drives" / day, PATH_XY_M[:25] if day in TRAIN else XY_M)
        kind = LOOKS[model]
        images = heights(rows) if model == "sci" else np.zeros((rows, 192), np.float32)
        attrs = {key: [] for key in kind.attributes}
        write_views(
            find("views", day, model), kind, images, np.tile(np.eye(4), (rows, 1, 1)), **attrs
        )
    fake = SimpleNamespace(
        name="campus",
        grid="10m",
        cell_m=10.0,
        simulated=True,
        train=" ".join(TRAIN),
        best="sci",
        find=find,
    )
    drives = root / "drives"
    fake.drive = lambda sequence: Drive.read(
        drives / sequence / "scans.zarr", drives / sequence / "submaps.zarr"
    )
    fake.footprint = Footprint.of(along(map(fake.drive, TRAIN)))
    fake.cut_short = {"sci": 0.1}
    fake.distance = Distance(correct_m=12.0)
    fake.bootstrap = Bootstrap()
    fake.train_xy_m = path_xy_m
    fake.results = results
    fake.rows = fake.driven = results_table()
    fake.settings = made_study(train=" ".join(TRAIN), tests=list(TESTS), methods=list(LOOKS))
    fake.families = list(LOOKS)
    learned = {
        "m2dp": SimpleNamespace(rounds=0, recipe={}),
        "sci": SimpleNamespace(rounds=4, recipe={"budget": "0.1"}),
    }
    fake.models = learned
    fake.trained = {"sci": find("train", model="sci"), "not_there": find("train")}
    fake.recipe = lambda model: {"epochs": "2", "_target_": "Sci"}
    fake.source = lambda *names, **model: find(*names, **model).as_posix()
    fake.trained["sci"].parent.mkdir(parents=True, exist_ok=True)
    fake.trained["sci"].touch()
    return fake


def drive(folder: Path, xy_m: np.ndarray) -> None:
    """Scans at these positions (n, 2), each of which sees a wall 10 m to its left."""
    world_T_scan = np.tile(np.eye(4), (len(xy_m), 1, 1))
    world_T_scan[:, :2, 3] = xy_m
    artifacts(folder, [WALL_M] * len(xy_m), world_T_scan)


def results_table() -> pd.DataFrame:
    """The table of results of both days as driven, and of the first day's queries turned.

    `sci` is right twice as often as `m2dp`.
    """
    rows = []
    for (model, share), (day, days) in product((("m2dp", 0.4), ("sci", 0.8)), TESTS.items()):
        numbers = {
            "recall_at_1": share - days / 1000,
            "answered": 0.25,
            "accepted": 6,
            "accepted_wrong": 2,
            "refused": 1,
            "refused_wrong": 1,
            "precision_at_threshold": 0.875,
            "kept_precision": 0.731,
            "wanted_precision": 0.9,
        }
        place = {"grid": "10m", "method": model, "sequence": day, "days": days}
        rows += [
            place | row(name, "distance", value, value - 0.05, value + 0.05)
            for name, value in numbers.items()
        ]
        rows += (
            [place | {"ask": PERTURBED, "of": "turned"} | row("recall_at_1", "distance", share / 4)]
            if days == 20
            else []
        )
    rows.append({"grid": "10m"} | row("correct_m", "distance", 12.0))
    return table(rows, study="campus", dataset="campus")


def heights(views: int) -> np.ndarray:
    """Scan Contexts of noise."""
    return np.random.default_rng(views).uniform(0, 16, (views, 40, 120)).astype(np.float32)


def entries(root: Path) -> list[Entry]:
    """The study as the page takes it."""
    fake = study(root)
    return [Entry(fake, sections(root), front(fake))]


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
