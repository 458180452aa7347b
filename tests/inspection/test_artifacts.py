from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pipeline import store
from pipeline.errors import ArtifactError, ConfigError, LogError
from pipeline.evaluation.numbers import MEASURES, NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.report import inspect
from pipeline.schemas import ALL, SCANS, Schema
from tests.inspection.scanner import scan

START_NS = 1_326_652_795 * 10**9  # 2012-01-15 18:39:55 UTC
LENGTHS = {"xyz": 3, "row": 4, "col": 4, "xy": 2, "ring": 6, "sector": 8, "rank": 5, "top_n": 25, "kind": 2}
LENGTHS |= {"protocol": 2, "number": len(NUMBERS), "measure": len(MEASURES), "bound": 2, "bound3": 3}
ATTRS = {"protocols": PROTOCOLS, "numbers": NUMBERS, "measures": MEASURES, "kinds": ("entropy", "energy")}
ATTRS |= {"layout": "odom_T_scan", "left_out": {"no true pose": 7}}
ATTRS |= dict.fromkeys(("thresholds", "reject_from"), (0.5, 2.0))
ROWS = 10


def made(path: Path, schema: Schema, **given: np.ndarray) -> Path:
    """An artifact of any kind: rows of plausible numbers, unless given."""
    with store.write(path, schema, **{name: ATTRS.get(name, 1.0) for name in schema.attrs}) as draft:
        for name, column in schema.columns.items():
            shape = [LENGTHS.get(dim, ROWS + dim.endswith("+1")) for dim in column.dims]
            draft.put(name, given.get(name, plain(name, shape, column.dtype)))
    return path


def plain(name: str, shape: list[int], dtype: str) -> np.ndarray:
    if name == "stamps_ns":
        return START_NS + np.arange(shape[0]) * 10**9
    if "_T_" in name:
        poses = np.tile(np.eye(4), (shape[0], 1, 1))
        poses[:, 0, 3] = 2.0 * np.arange(shape[0])  # 2 m a row along x: 18 m of path
        return poses
    return np.ones(shape, dtype) if dtype != "?" else np.indices(shape).sum(axis=0) % 2 == 0


def scans(path: Path, cloud: np.ndarray, attrs: Mapping[str, object] | None = None) -> Path:
    counts = np.full(ROWS, len(cloud))
    with store.write(path, SCANS, **{"grain_m": 0.005, "skipped": {}, "clipped": 0, **(attrs or {})}) as draft:
        draft.put("points", np.tile(np.rint(cloud / 0.005).astype(np.int16), (ROWS, 1)))
        draft.put("offsets", np.concatenate([[0], np.cumsum(counts)]))
        for name in ("stamps_ns", "world_T_scan", "odom_T_scan"):
            column = SCANS.columns[name]
            draft.put(name, plain(name, [ROWS, 4, 4][: len(column.dims)], column.dtype))
    return path


@pytest.mark.parametrize("schema", [schema for schema in ALL if schema.kind != "scans"], ids=lambda schema: schema.kind)
def test_every_kind_is_described_with_each_array_and_attribute(tmp_path: Path, schema: Schema) -> None:
    text = inspect(made(tmp_path / "a.zarr", schema)).text()
    assert f"{schema.kind}, version {schema.version}" in text.splitlines()[0]
    for name in (*schema.columns, *schema.attrs):
        assert f"\n  {name} " in text


def test_scans_tell_path_date_and_clouds(tmp_path: Path) -> None:
    found = inspect(scans(tmp_path / "2012-01-15.zarr", scan(64)))
    text = found.text()
    assert found.warnings == ()
    assert "2012-01-15 18:39:55 UTC" in text
    assert "18 m, step median 2 m" in text  # 9 steps of 2 m
    assert "clouds, vehicle frame" in text


def test_a_warning_that_all_scans_share_is_said_once(tmp_path: Path) -> None:
    found = inspect(scans(tmp_path / "a.zarr", scan(64, ground_m=-1.73)))
    assert len(found.warnings) == 1
    assert found.warnings[0].startswith("ground at z = −1.73 m")
    assert found.warnings[0].endswith("(scans 0, 2, 4, 7, 9 of the 5 looked at)")


def test_submaps_tell_what_they_gather_and_what_was_left_out(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "submaps")
    rows = {"first": np.arange(ROWS) // 2, "scans": np.arange(ROWS), "ground_m": -np.arange(ROWS) / 10}
    text = inspect(made(tmp_path / "a.zarr", schema, used=np.ones(ROWS, bool), **rows)).text()
    assert "1 … 6 scans each, laid out by odom_T_scan" in text  # the first alone; the last: 4, 5, … 9
    assert "−0.90 … 0.00 m" in text
    assert "7 anchors: no true pose" in text


def test_sweeps_in_an_outage_are_no_fault_and_are_not_diagnosed_alone(tmp_path: Path) -> None:
    truth = plain("world_T_scan", [ROWS, 4, 4], "f8")
    truth[3:5] = np.nan
    columns = {"points": np.ones((ROWS, 3), np.int16), "offsets": np.arange(ROWS + 1), "world_T_scan": truth}
    with store.write(tmp_path / "a.zarr", SCANS, grain_m=0.005, skipped={}, clipped=0) as draft:
        for name, column in SCANS.columns.items():
            draft.put(name, columns.get(name, plain(name, [ROWS, 4, 4][: len(column.dims)], column.dtype)))
    found = inspect(tmp_path / "a.zarr")
    assert found.warnings == ()
    assert "at 80 % of the scans" in found.text()
    assert "sweeps of a 2-D LiDAR" in found.text()


def test_views_tell_their_empty_bins(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "views")
    images = np.zeros((ROWS, 6, 8), np.float32)
    images[1:, :3] = 4.5  # half of nine images of ten, and one blank: 55 % empty
    found = inspect(made(tmp_path / "a.zarr", schema, images=images))
    assert "55.0 %" in found.text()
    assert "4.50 m" in found.text()
    assert found.warnings[0].startswith("1 blank views")


def test_a_ranking_tells_what_each_kind_of_novelty_rejects(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "rankings")
    novelty = np.stack([np.linspace(0.1, 1.0, ROWS), np.ones(ROWS)], axis=1).astype(np.float32)
    found = inspect(made(tmp_path / "a.zarr", schema, novelty=novelty, confidence=np.full(ROWS, np.nan, np.float32)))
    text = found.text()
    assert "rejects 60.0 % from 0.5 on" in text  # .5 … 1.0 are six of ten
    assert "rejects 0.0 % from 2 on" in text
    assert "confidence     told for none" in text
    assert found.warnings[0].startswith("every query gets the same first answer")


def test_an_evaluation_tells_both_protocols_and_their_intervals(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "evaluations")
    seen = np.stack([np.arange(ROWS) < 8, np.arange(ROWS) < 4])
    unseen = np.stack([np.arange(ROWS) >= 8, np.arange(ROWS) >= 9])
    true_rank = np.where(seen, np.stack([np.arange(ROWS) % 2, np.zeros(ROWS, int)]), -1)  # by cells every other is second
    interval = np.full((2, len(NUMBERS), 2), np.nan)
    interval[0, 0] = 0.25, 0.75
    columns = {"seen": seen, "unseen": unseen, "true_rank": true_rank, "interval": interval}
    found = inspect(made(tmp_path / "a.zarr", schema, **columns))
    text = found.text()
    assert "by cells" in text
    assert "8 seen and 2 unseen" in text
    assert "at 1 0.500 (0.250–0.750), at 5 1.000" in text
    assert "by distance" in text
    assert "4 seen and 1 unseen" in text
    assert "at 1 1.000, at 5 1.000" in text
    assert "heading    median error 1.000°, within 10° 1.000 of the right" in text
    assert found.warnings == ()
    untold = inspect(made(tmp_path / "b.zarr", schema, **columns, heading_error_deg=np.full(ROWS, np.nan))).text()
    assert "\n  heading  " not in untold


def test_an_evaluation_without_a_seen_query_warns(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "evaluations")
    seen = np.stack([np.ones(ROWS, bool), np.zeros(ROWS, bool)])
    found = inspect(made(tmp_path / "a.zarr", schema, seen=seen, unseen=~seen, true_rank=np.where(seen, 0, -1)))
    assert "at 1 none" in found.text()
    assert found.warnings == ("no query was seen in training by distance: recall and AUC mean nothing there",)


def test_provenance_is_what_dvc_lock_says(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "labels")
    path = made(tmp_path / "artifacts" / "labels" / "a.zarr", schema)
    lock = tmp_path / "dvc.lock"
    assert f"there is no {lock}" in inspect(path, lock=lock).text()
    lock.write_text(
        "schema: '2.0'\nstages:\n  labels@a:\n    cmd: python -m stages.labels a\n"
        "    deps:\n    - path: stages/labels.py\n      hash: md5\n      md5: 0123456789abcdef\n      size: 1200\n"
        "    - path: artifacts/submaps/a.zarr\n      hash: md5\n      md5: fedcba98.dir\n      size: 34000\n      nfiles: 9\n"
        "    params:\n      conf/labels.yaml:\n        cell_m: 10.0\n        out:\n"
        "    outs:\n    - path: artifacts/labels/a.zarr\n      md5: ff.dir\n"
    )
    text = inspect(path, lock=lock).text()
    for words in (
        "labels@a",
        "python -m stages.labels a",
        "conf/labels.yaml: cell_m=10",
        "artifacts/submaps/a.zarr (fedcba98, 34 kB, 9 files)",
        "code    stages/labels.py",
    ):
        assert words in text
    other = made(tmp_path / "artifacts" / "labels" / "b.zarr", schema)
    assert "knows it not" in inspect(other, lock=lock).text()


def test_an_artifact_that_lost_a_file_is_not_what_dvc_lock_recorded(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "labels")
    path, lock = made(tmp_path / "a.zarr", schema), tmp_path / "dvc.lock"
    files = [file for file in path.rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    lock.write_text(f"stages:\n  labels:\n    outs:\n    - path: a.zarr\n      size: {size}\n      nfiles: {len(files)}\n")
    assert inspect(path, lock=lock).warnings == ()
    next(file for file in files if file.name != "zarr.json").unlink()
    assert inspect(path, lock=lock).warnings[0].startswith(f"not what {lock} recorded: {len(files) - 1} files")


def test_a_model_tells_its_arrays_and_recipe(tmp_path: Path) -> None:
    path = tmp_path / "sci.safetensors"
    store.write_model(path, {"weight": np.array([[1.0, np.nan]], np.float32), "scale": np.array(2.0)}, {"epochs": 30})
    found = inspect(path)
    assert "epochs  30" in found.text()
    assert found.warnings[0].startswith("NaN/inf in weight")


def test_a_broken_artifact_is_one_line(tmp_path: Path) -> None:
    schema = next(schema for schema in ALL if schema.kind == "labels")
    path = made(tmp_path / "a.zarr", schema)
    shard = next(file for file in (path / "places").rglob("*") if file.is_file() and file.name != "zarr.json")
    shard.write_bytes(shard.read_bytes()[:-9])
    with pytest.raises(ArtifactError, match=r"cannot be read whole .*dvc repro") as error:
        inspect(path)
    assert "\n" not in str(error.value)
    (path / "zarr.json").write_text('{"attributes": {"kind": "casks"}}')
    with pytest.raises(ArtifactError, match="kind casks"):
        inspect(path)
    (path / "zarr.json").write_text('{"attr')
    with pytest.raises(ArtifactError, match="cut short"):
        inspect(path)


def test_what_is_missing_or_unknown_is_told(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="dvc repro"):
        inspect(tmp_path / "a.zarr")
    with pytest.raises(LogError, match="no such file"):
        inspect(tmp_path / "a.bin")
    (tmp_path / "notes.md").write_text("x")
    with pytest.raises(ConfigError, match="no kind of file"):
        inspect(tmp_path / "notes.md")
    (tmp_path / "bad.safetensors").write_bytes(b"xx")
    with pytest.raises(ArtifactError, match="not a safetensors"):
        inspect(tmp_path / "bad.safetensors")
    with pytest.raises(LogError, match=r"no artifact, folder of scans.*notes.md"):
        inspect(tmp_path)
