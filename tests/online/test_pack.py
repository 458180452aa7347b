"""A site is packed from the artifacts of a study, and localises a scan of its places."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

import stages.poses
from pipeline.core import schemas, store
from pipeline.core.building import target_of
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.matching.places import label
from pipeline.matching.ranking import Rows
from pipeline.methods.scan_context import ScanContext50
from pipeline.online.description import describe
from pipeline.online.pack import Packing, Trained
from pipeline.online.site import Site
from pipeline.posing.learned_verdict import Learned, basis
from pipeline.posing.targets import write_map
from pipeline.posing.validation import ValidationBlocks
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout
from pipeline.views.draw import UNPERTURBED
from pipeline.views.scan_context import ScanContext
from stages.poses import scans_basis
from tests.artifacts import write_views
from tests.online.made import ANCHORS, GRID, scan
from tests.posing.scene import planar, scene, seen_from
from tests.readers.damage import one_line
from tests.studies.made import RECORDED
from tests.studies.made import study as made_study
from tests.views.made import artifacts

ROOT = Path(__file__).parents[2]
STUDY = made_study("three", train="monday", methods=["scan_context", "sad"], **RECORDED)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of three places, eight scans in each, half a metre apart."""
    folder = tmp_path_factory.mktemp("project")
    shutil.copytree(ROOT / "conf", folder / "conf")
    shutil.copy(folder / "conf/dataset/folder.yaml", folder / "conf/dataset/three.yaml")
    steps = [(row, planar(0.5 * i, 0, 0)) for row in range(3) for i in range(8)]
    clouds = [seen_from(scene(row), step) for row, step in steps]
    poses = np.array([ANCHORS[row] @ step for row, step in steps])
    made = folder / "artifacts"
    images = np.stack([ScanContext()(cloud) for cloud in clouds])
    artifacts(folder / "made", clouds, poses)
    for kind in ("scans", "submaps"):
        (made / kind / "three").mkdir(parents=True)
        shutil.move(folder / f"made/{kind}.zarr", made / f"{kind}/three/monday.zarr")
    labels = label(poses, poses, GRID, 0)
    store.write(made / "labels/three/10m/monday.zarr", labels)
    path = made / "views/three/scan_context/monday.zarr"
    write_views(path, schemas.ScanContextViews, images, poses, cases=UNPERTURBED)
    model = ScanContext50().learn(Rows(images, np.arange(24), poses), labels.places, Progress())
    recipe = {"_target_": target_of(ScanContext50()), "view": "scan_context", "candidates": 50}
    store.write_model(made / "train/three/10m/scan_context.zarr.zip", model, recipe)
    return folder


def packed(project: Path, name: str, out: Path) -> str:
    """Pack the model `name` of the project; returns what the site holds, in a line."""
    _, grid, model = name.split("/")
    trained = Trained.of_study(Layout(project / "artifacts"), STUDY, grid, model)
    return Packing(project / "conf").pack(trained, out, Progress())


def test_a_packed_site_localises_a_scan(project: Path, tmp_path: Path) -> None:
    said = packed(project, "three/10m/scan_context", tmp_path / "three.site")
    assert said.startswith(f"{tmp_path / 'three.site'}: 3 places, 24 submaps")
    site = Site.open(tmp_path / "three.site")
    points_m, world_T_robot = scan(2, 1.0, 0.5, 20.0)
    # 24 validation queries are too few for any target precision
    with one_line(
        InputError, "target_precision=0.99: this site has no threshold for it; nor for any other"
    ):
        site.localize(points_m, strict=True)
    unaccepted = site.localize(points_m)
    assert (unaccepted.verdict, unaccepted.target_precision) == ("rejected", None)
    fix = site.localize(points_m, None)
    np.testing.assert_allclose(fix.world_T_sensor, world_T_robot, atol=0.1)
    assert site.description.reader["_target_"] == "pipeline.readers.folder.Folder"
    assert site.description.sensor.ground_m == pytest.approx(0, abs=0.05)
    assert 0 < site.fixer.least_overlap <= 0.3  # it is learned from validation blocks
    assert site.description.provenance.train == "monday"
    assert "site three/10m/scan_context" in describe(tmp_path / "three.site").text()


def test_a_site_is_packed_from_the_verdict_of_the_stage_poses(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The site has the same bytes, and no validation block is registered a second time."""
    packed(project, "three/10m/scan_context", tmp_path / "learned.site")
    made = project / "artifacts"
    scans = store.read(made / "scans/three/monday.zarr", schemas.Scans)
    submaps = store.read(made / "submaps/three/monday.zarr", schemas.Submaps)
    settings = read_yaml(ROOT / "conf/map.yaml")
    lengths = {key: value for key, value in settings.items() if key.endswith("_m")}
    write_map(made / "map/three/monday.zarr", scans, submaps, **lengths)
    words = [
        "method=scan_context",
        "view=scan_context",
        "train=monday",
        "sequences=[]",
        "compute=threads",
        f"model={made}/train/three/10m/scan_context.zarr.zip",
        f"views={made}/views/three/scan_context",
        f"rankings={made}/localize/three/10m/scan_context",
        f"map={made}/map/three",
        f"labels={made}/labels/three/10m",
        f"scans={made}/scans/three",
        f"submaps={made}/submaps/three",
        f"out={made}/poses/three/10m/scan_context",
    ]
    with initialize_config_dir(str(ROOT / "conf"), version_base=None):
        stages.poses.main.run(compose("poses", words))
    monkeypatch.setattr(ValidationBlocks, "evidence", None)
    packed(project, "three/10m/scan_context", tmp_path / "read.site")
    assert (tmp_path / "read.site").read_bytes() == (tmp_path / "learned.site").read_bytes()
    # the verdict of another model is none of this one's
    path = made / "poses/three/10m/scan_context/verdict.zarr"
    assert Learned.read(path, basis(b"another model")) is None


def test_a_budgets_own_search_is_in_what_its_verdict_was_learned_with(tmp_path: Path) -> None:
    """The verdict of a cheaper search is not used for a site, which searches the whole map."""
    model = tmp_path / "model"
    model.write_bytes(b"model")
    rounds = {}
    for budget in ("demo", "minutes"):
        with initialize_config_dir(str(ROOT / "conf"), version_base=None):
            cfg = compose("poses", [f"budget={budget}"])
        settings = SimpleNamespace(**{**cfg, "model": model})
        settings.budget = SimpleNamespace(poses=cfg.budget.get("poses"))
        rounds[budget] = json.loads(scans_basis(settings))["fixer"]["rounds"]
    assert rounds == {"demo": [5, 20], "minutes": [5]}


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("three/10m/sci", "no such model to pack, expected one of scan_context"),
        ("three/10m/scan_context-pose", "pack three/10m/scan_context; every site makes poses"),
        ("three/10m/sad", "matches sequences of bird-views"),
    ],
)
def test_a_name_that_cannot_be_packed_is_refused_with_what_can(
    project: Path, tmp_path: Path, name: str, says: str
) -> None:
    with one_line(ConfigError, says):
        packed(project, name, tmp_path / "a.site")
