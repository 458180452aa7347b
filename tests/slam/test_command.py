"""`yearloc slam` writes a trajectory, a map and a picture, and refuses what it cannot do."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.core.progress import Progress
from pipeline.formats import pcd
from pipeline.opening.map_files import MapFiles
from pipeline.readers.folder import read_tum
from tests.slam.round import circle, drive

pytest.importorskip("gtsam")


def test_a_folder_of_clouds_becomes_a_trajectory_a_map_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Clouds of a sensor 1 m above the ground, numbered: a stamp is the number in seconds."""
    clouds = tmp_path / "monday"
    clouds.mkdir()
    log = drive(circle(8))
    for row in range(8):
        points_m = log.points(row) - np.array([0.0, 0.0, 1.0])
        (clouds / f"{row:06d}.pcd").write_bytes(pcd.encode(points_m))
    out, whole, picture = (tmp_path / name for name in ("poses.txt", "map.pcd", "way.png"))
    main(["slam", str(clouds), "-o", str(out), "--map", str(whole), "--picture", str(picture)])
    stamps_ns, poses = read_tum(out)
    assert stamps_ns.tolist() == [row * 10**9 for row in range(8)]
    way = np.linalg.inv(circle(8)[0]) @ circle(8)
    np.testing.assert_allclose(poses[:, :2, 3], way[:, :2, 3], atol=0.1)
    assert sum(map(len, MapFiles.of([whole]).chunks(Progress()))) > 1000
    assert picture.read_bytes().startswith(b"\x89PNG")
    reported = capsys.readouterr().err
    assert "8 of 8 scans have a pose" in reported
    assert "no loop" in reported


def test_a_command_without_outputs_or_with_wrong_endings_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, says in (
        (["slam", str(tmp_path)], "nothing to write"),
        (["slam", str(tmp_path), "--map", str(tmp_path / "map.xyz")], "expected a map FILE.pcd"),
        (
            ["slam", str(tmp_path), "--picture", str(tmp_path / "p.jpg")],
            "expected a file that ends",
        ),
        (["slam", str(tmp_path), "-o", str(tmp_path / "poses.txt")], "no log"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 1
        assert says in capsys.readouterr().err
