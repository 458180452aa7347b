"""Recordings of a log for people: rerun's file, and a bag for Foxglove."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.formats.bag import CLOUD, POSE_COVARIANCE
from pipeline.formats.bag_file import BagFile
from pipeline.formats.pointcloud2 import decode
from tests.online.made import packed, scan
from tests.posing.scene import scene


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The site, and a folder of a scan that is accepted, one from elsewhere, and one that tells nothing."""
    folder = tmp_path_factory.mktemp("drive")
    for number, points_m in enumerate((scan()[0], scene(7), np.ones((9, 3)))):
        np.save(folder / f"{number}.npy", points_m.astype(np.float32))
    return str(packed(tmp_path_factory.mktemp("site"))), str(folder)


def test_a_file_for_rerun(drive: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["watch", *drive, "--save", str(tmp_path / "day.rrd")])
    assert "3 scans: 1 accepted, 1 rejected, 1 no pose" in capsys.readouterr().err
    data = (tmp_path / "day.rrd").read_bytes()
    assert data[:3] == b"RRF"
    assert all(name in data for name in (b"world/map", b"world/scan", b"novelty/threshold", b"places"))


def test_a_bag_for_foxglove(drive: tuple[str, str], tmp_path: Path) -> None:
    main(["watch", *drive, "--save", str(tmp_path / "day.mcap")])
    bag = BagFile(tmp_path / "day.mcap")
    assert {name: (topic.kind, topic.count) for name, topic in bag.topics.items()} == {
        "/map": (CLOUD, 1),
        "/scan": (CLOUD, 2),
        "/fixes": (CLOUD, 2),
        "/fix": (POSE_COVARIANCE, 1),
    }
    fix = decode(bag.decode(bag.first("/fixes") or b"", CLOUD))
    np.testing.assert_allclose(fix[0, :2], scan()[1][:2, 3], atol=0.1)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--save", "day.txt"], "--save day.txt: expected FILE.rrd or FILE.mcap"),
        (["--save", "day.rrd", "--every", "0"], "--every 0: expected at least 1"),
        (["--save", "day.rrd", "--promise", "1"], "promise=1: this site cannot promise that, it can 0.95 and 0.99"),
    ],
)
def test_a_mistake_is_one_line(drive: tuple[str, str], capsys: pytest.CaptureFixture[str], words: list[str], says: str) -> None:
    with pytest.raises(SystemExit):
        main(["watch", *drive, *words])
    assert says in capsys.readouterr().err.splitlines()[-1]
