"""A recording is followed while it is written: clouds that wait too long are dropped and
counted."""

import time
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.formats.bag import BagWriter
from pipeline.online.follow import Following
from pipeline.online.inputs import ScanOptions
from pipeline.online.odometry import Newest
from tests.commands import Command
from tests.online.made import scan
from tests.posing.scene import planar, seen_from
from tests.readers.bags import BODY_T_LIDAR, START_NS, cloud

COUNT = 24


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a recording of COUNT clouds, a tenth of a second apart."""
    folder = tmp_path_factory.mktemp("recorded") / "day"
    points_m = seen_from(scan()[0], BODY_T_LIDAR)
    with BagWriter(folder, "mcap") as bag:
        bag.static_transform(START_NS, "base_link", "lidar", BODY_T_LIDAR)
        for i in range(COUNT):
            cloud(bag, START_NS + i * 10**8, "lidar", points_m)
    (file,) = folder.glob("*.mcap")
    return file.read_bytes()


def record(path: Path, data: bytes, seconds: float) -> Thread:
    """Write a file in pieces, as a recorder does, over some seconds."""
    path.write_bytes(b"")

    def writing() -> None:
        for piece in np.array_split(np.frombuffer(data, np.uint8), 40):
            with path.open("ab") as file:
                file.write(piece.tobytes())
            time.sleep(seconds / 40)

    thread = Thread(target=writing)
    thread.start()
    return thread


def test_every_cloud_is_handed_out_or_counted_as_dropped(recorded: bytes, tmp_path: Path) -> None:
    thread = record(tmp_path / "day.mcap", recorded, 2.0)
    following = Following(tmp_path / "day.mcap", ScanOptions({}), 1.0)
    seen = []
    for one in following.scans():
        time.sleep(0.5)  # slower than they come
        seen.append(one)
    thread.join()
    assert following.dropped > 0
    assert len(seen) + following.dropped == COUNT
    assert seen[-1].stamp_ns == START_NS + (COUNT - 1) * 10**8
    # the points are placed by the recording's transforms
    np.testing.assert_allclose(seen[-1].points(), scan()[0], atol=1e-4)


def test_the_command_follows_a_recording(
    recorded: bytes, three_places: Path, tmp_path: Path, yearloc: Command
) -> None:
    thread = record(tmp_path / "day.mcap", recorded, 1.0)
    words = ("localize", three_places, tmp_path / "day.mcap", "--follow", "--idle", 1)
    fixes, summary = yearloc.run(*words)
    thread.join()
    assert fixes.count(" accepted ") >= 1
    assert " 0 rejected, 0 no pose" in summary


@pytest.mark.parametrize("odometry", ["/wheels", "tf:odom>base_link"])
def test_odometry_is_interpolated_at_the_stamps_of_clouds(tmp_path: Path, odometry: str) -> None:
    """A robot drives at 1 m/s; each cloud is stamped half way between two of its poses."""
    clouds = 4
    poses = 10
    with BagWriter(tmp_path / "day", "mcap") as bag:
        bag.static_transform(START_NS, "base_link", "imu_link", planar(0, 0, 0))
        for i in range(poses):
            stamp_ns = START_NS + i * 10**8
            if odometry == "/wheels":
                bag.odometry(stamp_ns, "odom", "base_link", planar(i / 10, 0, 0), "/wheels")
            else:
                bag.transform(stamp_ns, "odom", "base_link", planar(i / 10, 0, 0))
            if i < clouds:
                cloud(bag, stamp_ns + 5 * 10**7, "base_link", np.ones((9, 3)))
    (file,) = (tmp_path / "day").glob("*.mcap")
    seen = list(Following(file, ScanOptions({}, odometry=odometry), 0.3).scans())
    xs_m = [one.odom_T_scan[0, 3] for one in seen]
    np.testing.assert_allclose(xs_m, [0.05, 0.15, 0.25, 0.35], atol=1e-6)
    other = Following(file, ScanOptions({}, odometry="/feet"), 0.3)
    assert all(np.isnan(one.odom_T_scan).all() for one in other.scans())
    assert "no pose of /feet came" in other.damage


def test_a_pose_is_extrapolated_for_a_moment() -> None:
    """Two poses are 0.1 s and 0.2 m apart: 0.1 s later the robot is 0.2 m farther on.

    A second later its pose is unknown.
    """
    newest = Newest()
    newest.add(START_NS, planar(1, 0, 0))
    newest.add(START_NS + 10**8, planar(1.2, 0, 0))
    np.testing.assert_allclose(newest.at(START_NS + 2 * 10**8), planar(1.4, 0, 0), atol=1e-9)
    np.testing.assert_allclose(newest.at(START_NS + 5 * 10**7), planar(1.1, 0, 0), atol=1e-9)
    assert np.isnan(newest.at(START_NS + 10**9)).all()


def test_a_damaged_recording_is_read_up_to_the_damage_which_is_reported(
    recorded: bytes, tmp_path: Path
) -> None:
    half = len(recorded) // 2
    (tmp_path / "day.mcap").write_bytes(recorded[:half] + recorded[half + 1001 :])
    following = Following(tmp_path / "day.mcap", ScanOptions({}), 0.3)
    assert 0 < len(list(following.scans())) + following.dropped < COUNT
    assert "day.mcap: damaged, what follows was not read" in following.damage


@pytest.mark.parametrize(
    ("data", "says"),
    [(b"", r"no PointCloud2 came within 0\.3 s"), (b"no recording at all", "damaged")],
    ids=["empty", "text"],
)
def test_a_file_without_clouds_is_an_error_in_a_line(
    tmp_path: Path, data: bytes, says: str
) -> None:
    (tmp_path / "day.mcap").write_bytes(data)
    with pytest.raises(LogError, match=rf"day\.mcap: {says}"):
        list(Following(tmp_path / "day.mcap", ScanOptions({}), 0.3).scans())
    with pytest.raises(LogError, match=r"no \.mcap recording to follow"):
        list(Following(tmp_path / "none", ScanOptions({}), 0.3).scans())
