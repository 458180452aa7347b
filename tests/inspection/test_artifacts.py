"""Tests what `yearloc inspect` says of artifacts, of their provenance, and of broken ones."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError, LogError
from pipeline.evaluation.numbers import MEASURES, NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.inspection.dictionary import KINDS
from pipeline.inspection.report import inspect
from tests.inspection.scanner import assert_says, scan
from tests.readers.damage import one_line

START_NS = 1_326_652_795 * 10**9  # 2012-01-15 18:39:55 UTC
ROWS = 10
LENGTHS = {
    "xyz": 3,
    "row": 4,
    "col": 4,
    "xy": 2,
    "ring": 6,
    "sector": 8,
    "rank": 5,
    "top_n": 25,
    "kind": 2,
    "case": 1,
    "protocol": 2,
    "number": len(NUMBERS),
    "measure": len(MEASURES),
    "bound3": 3,
    "confidence2": 2,
}
"""Lengths of dimensions; other dimensions have ROWS."""
ATTRS = {
    "protocols": PROTOCOLS,
    "numbers": NUMBERS,
    "measures": MEASURES,
    "kinds": ("entropy", "energy"),
    "bootstrap": {"block_m": 50.0},
    "layout": "odom_T_scan",
    "left_out": {"no true pose": 7},
    "grain_m": 0.005,
    "skipped": {},
    "clipped": 0,
    "blind": dict.fromkeys(PROTOCOLS, 0.1),
    "unsuited": {},
    "claims": {},
    "thresholds": (0.5, 2.0),
    "reject_from": (0.5, 2.0),
    "validation_precision": (0.731, None),
    "right_within": (2.0, 5.0),
}
"""Values of attributes; other attributes are 1."""


def write(path: Path, kind: str, **arrays: np.ndarray) -> Path:
    """Write an artifact of any kind with these arrays; the others hold plausible numbers."""
    schema = KINDS[kind]
    attributes = {name: ATTRS.get(name, 1.0) for name in schema.attributes}
    with store.draft(path, schema, **attributes) as draft:
        for name, column in schema.columns.items():
            shape = [LENGTHS.get(dim, ROWS + dim.endswith("+1")) for dim in column.dims]
            draft.put(name, arrays.get(name, plain(name, shape, column.dtype)))
    return path


def plain(name: str, shape: list[int], dtype: str) -> np.ndarray:
    """Plausible numbers for the array `name`: a stamp a second, a pose every 2 m, or ones."""
    if name == "stamps_ns":
        return START_NS + np.arange(shape[0]) * 10**9
    if "_T_" in name:
        poses = np.tile(np.eye(4), (shape[0], 1, 1))
        poses[:, 0, 3] = 2.0 * np.arange(shape[0])  # 2 m a row along x: 18 m of path
        return poses
    return np.ones(shape, dtype) if dtype != "bool" else np.indices(shape).sum(axis=0) % 2 == 0


def scans(path: Path, cloud: np.ndarray, **arrays: np.ndarray) -> Path:
    """Write an artifact of scans that all hold the same cloud."""
    points = np.tile(np.rint(cloud / 0.005).astype(np.int16), (ROWS, 1))
    return write(path, "scans", points=points, offsets=len(cloud) * np.arange(ROWS + 1), **arrays)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "scans"])
def test_every_kind_is_described_with_each_array_and_attribute(tmp_path: Path, kind: str) -> None:
    text = inspect(write(tmp_path / "a.zarr", kind)).text()
    schema = KINDS[kind]
    assert f"{schema.kind}, version {schema.version}" in text.splitlines()[0]
    for name in (*schema.columns, *schema.attributes):
        assert f"\n  {name} " in text


def test_scans_are_described_with_path_date_and_clouds(tmp_path: Path) -> None:
    found = inspect(scans(tmp_path / "2012-01-15.zarr", scan(64)))
    assert found.warnings == ()
    assert_says(
        found, "2012-01-15 18:39:55 UTC", "18 m, step median 2 m", "clouds, vehicle frame"
    )  # 9 steps of 2 m


def test_a_warning_that_all_scans_share_is_given_once(tmp_path: Path) -> None:
    found = inspect(scans(tmp_path / "a.zarr", scan(64, ground_m=-1.73)))
    (warning,) = found.warnings
    assert warning.startswith("ground at z = −1.73 m")
    assert warning.endswith("(scans 0, 2, 4, 7, 9 of the 5 looked at)")


def test_submaps_are_described_with_what_they_gather_and_leave_out(tmp_path: Path) -> None:
    count = np.arange(ROWS)
    rows = {"first": count // 2, "scans": count, "ground_m": -count / 10, "used": count >= 0}
    found = inspect(write(tmp_path / "a.zarr", "submaps", **rows))
    # The first gathers itself alone; the last: 4, 5, … 9.
    assert_says(found, "1 … 6 scans each, placed by odom_T_scan", "−0.90 … 0.00 m")
    assert_says(found, "7 anchors: no true pose")


def test_sweeps_in_an_outage_are_no_fault_and_are_not_diagnosed_alone(tmp_path: Path) -> None:
    ground_truth = plain("world_T_scan", [ROWS, 4, 4], "f8")
    ground_truth[3:5] = np.nan
    found = inspect(scans(tmp_path / "a.zarr", np.ones((1, 3)), world_T_scan=ground_truth))
    assert found.warnings == ()
    assert_says(found, "at 80 % of the scans", "sweeps of a 2-D LiDAR")


def test_views_are_described_with_their_empty_bins(tmp_path: Path) -> None:
    images = np.zeros((ROWS, 6, 8), np.float32)
    images[1:, :3] = 4.5  # half of nine images of ten, and one blank: 55 % empty
    found = inspect(write(tmp_path / "a.zarr", "views", images=images))
    assert_says(found, "55.0 %", "4.50 m")
    assert found.warnings[0].startswith("1 blank views")


def test_a_ranking_is_described_with_what_each_kind_of_novelty_rejects(tmp_path: Path) -> None:
    novelty = np.stack([np.linspace(0.1, 1.0, ROWS), np.ones(ROWS)], axis=1).astype(np.float32)
    columns = {"novelty": novelty, "confidence": np.full(ROWS, np.nan, np.float32)}
    found = inspect(write(tmp_path / "a.zarr", "rankings", **columns))
    # .5 … 1.0 are six of ten.
    assert_says(found, "rejects 60.0 % from 0.5 on", "rejects 0.0 % from 2 on")
    assert_says(found, "confidence     none")
    assert found.warnings[0].startswith("every query gets the same first answer")


def test_an_evaluation_is_described_by_both_protocols_with_intervals(tmp_path: Path) -> None:
    seen = np.stack([np.arange(ROWS) < 8, np.arange(ROWS) < 4])
    unseen = np.stack([np.arange(ROWS) >= 8, np.arange(ROWS) >= 9])
    numbers = np.ones((2, len(NUMBERS), 3))
    numbers[..., 1:] = np.nan
    numbers[0, 0] = 0.5, 0.25, 0.75
    columns = {"seen": seen[None], "unseen": unseen[None]}
    found = inspect(write(tmp_path / "a.zarr", "evaluations", **columns, numbers=numbers[None]))
    assert_says(found, "by cells", "8 seen and 2 unseen", "at 1 0.500 (0.250–0.750), at 5 1.000")
    assert_says(found, "by distance", "4 seen and 1 unseen", "at 1 1.000, at 5 1.000")
    assert_says(found, "heading    median error 1.000°, within 10° 1.000 of the right")
    assert found.warnings == ()
    numbers[:, NUMBERS.index("heading_within_10deg")] = np.nan
    columns["numbers"] = numbers[None]
    without_heading = inspect(write(tmp_path / "b.zarr", "evaluations", **columns))
    assert "\n  heading  " not in without_heading.text()


def test_an_evaluation_without_a_seen_query_warns(tmp_path: Path) -> None:
    seen = np.stack([np.ones(ROWS, bool), np.zeros(ROWS, bool)])
    none = np.full((1, 2, len(NUMBERS), 3), np.nan)
    columns = {"seen": seen[None], "unseen": ~seen[None], "numbers": none}
    found = inspect(write(tmp_path / "a.zarr", "evaluations", **columns))
    assert "at 1 none" in found.text()
    assert found.warnings == (
        "no query was seen in training by distance: recall and AUC mean nothing there",
    )


def test_provenance_is_what_dvc_lock_says(tmp_path: Path) -> None:
    path = write(tmp_path / "artifacts" / "labels" / "a.zarr", "labels")
    lock = tmp_path / "dvc.lock"
    assert f"there is no {lock}" in inspect(path, lock=lock).text()
    lock.write_text(
        "schema: '2.0'\nstages:\n  labels@a:\n    cmd: python -m stages.labels a\n    deps:\n    "
        "- path: stages/labels.py\n      hash: md5\n      md5: 0123456789abcdef\n      size: "
        "1200\n    - path: artifacts/submaps/a.zarr\n      hash: md5\n      md5: fedcba98.dir\n   "
        "   size: 34000\n      nfiles: 9\n    params:\n      conf/labels.yaml:\n        cell_m: "
        "10.0\n        out:\n    outs:\n    - path: artifacts/labels/a.zarr\n      md5: ff.dir\n"
    )
    found = inspect(path, lock=lock)
    assert_says(found, "labels@a", "python -m stages.labels a", "conf/labels.yaml: cell_m=10")
    assert_says(found, "code    stages/labels.py")
    assert_says(found, "artifacts/submaps/a.zarr (fedcba98, 34 kB, 9 files)")
    other = write(tmp_path / "artifacts" / "labels" / "b.zarr", "labels")
    assert "has no entry for it" in inspect(other, lock=lock).text()


def test_an_artifact_that_lost_a_file_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.zarr", "labels")
    lock = tmp_path / "dvc.lock"
    files = [file for file in path.rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    lock.write_text(
        f"stages:\n  labels:\n    outs:\n    - path: a.zarr\n      size: {size}\n      nfiles: "
        f"{len(files)}\n"
    )
    assert inspect(path, lock=lock).warnings == ()
    (path / "more").touch()
    first_warning, *_ = inspect(path, lock=lock).warnings
    assert first_warning.startswith(f"not what {lock} recorded: {len(files) + 1} files")
    next(file for file in files if file.name != "zarr.json").unlink()
    with one_line(ArtifactError, r"a\.zarr: 1 of 1 files of \w+ are missing"):
        inspect(path, lock=lock)


def test_a_model_is_described_with_its_arrays_and_recipe(tmp_path: Path) -> None:
    path = tmp_path / "sci.zarr.zip"
    arrays = {"weight": np.array([[1.0, np.nan]], np.float32), "scale": np.array(2.0)}
    store.write_model(path, arrays, {"epochs": 30})
    found = inspect(path)
    assert "epochs  30" in found.text()
    assert found.warnings[0].startswith("NaN/inf in weight")


def test_a_broken_artifact_raises_an_error_of_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.zarr", "labels")
    files = (path / "places").rglob("*")
    shard = next(file for file in files if file.is_file() and file.name != "zarr.json")
    shard.write_bytes(shard.read_bytes()[:-9])
    with one_line(ArtifactError, r"places is damaged .*dvc repro"):
        inspect(path)
    wrong = {'{"attributes": {"kind": "casks"}}': "kind casks", '{"attr': "cut short"}
    for text, says in wrong.items():
        (path / "zarr.json").write_text(text)
        with one_line(ArtifactError, says):
            inspect(path)


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("a.zarr", ArtifactError, "dvc repro"),
        ("a.bin", LogError, "no such file"),
        ("notes.md", ConfigError, "no kind of file"),
        ("maps/a.laz", LogError, "no LAS file"),
        ("a.pcap", ConfigError, "ros2 bag record"),
        ("tue.db3.zstd", ConfigError, "packed: name the folder"),
        ("tue.bag.gz", ConfigError, "packed: unpack it with"),
        ("bad.zarr.zip", ArtifactError, "not a whole model"),
        ("", LogError, r"no artifact, folder of scans.*notes.md"),
    ],
)
def test_a_missing_or_unknown_file_raises_an_error_of_one_line(
    tmp_path: Path, name: str, kind: type, says: str
) -> None:
    (tmp_path / "maps").mkdir()
    for existing in (
        "notes.md",
        "bad.zarr.zip",
        "maps/a.laz",
        "a.pcap",
        "tue.db3.zstd",
        "tue.bag.gz",
    ):
        (tmp_path / existing).write_text("x")
    with one_line(kind, says):
        inspect(tmp_path / name)


def test_in_40_columns_lines_wrap_between_words(tmp_path):
    text = inspect(write(tmp_path / "a.zarr", "evaluations")).text(40)
    assert [line for line in text.splitlines()[1:] if len(line) > 40 and " " in line.strip()] == []
