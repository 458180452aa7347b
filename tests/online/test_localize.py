"""`yearloc localize` takes scans from any source, and writes their fixes in every format."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.core import replacing
from pipeline.core.frames import pose
from pipeline.formats import nclt, pcd
from pipeline.formats.bag import POSE_COVARIANCE, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.inspection.report import inspect
from pipeline.online.outputs import COLUMNS
from pipeline.online.tilt import lean
from tests.commands import Command
from tests.online.made import scan
from tests.posing.scene import planar, scene, seen_from
from tests.readers.bags import BODY_T_LIDAR, cloud

UTIME = 1_326_652_795_280_148


@pytest.fixture
def localize(three_places: Path, capsys: pytest.CaptureFixture[str]) -> Command:
    """`yearloc localize` by the site of three places."""
    return Command(capsys, ("localize", three_places))


def floats(folder: Path, name: str = f"{UTIME}.bin") -> Path:
    """Write the scan as a file in KITTI's format."""
    points_m, _ = scan()
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    np.column_stack([points_m, np.ones(len(points_m))]).astype("<f4").tofile(path)
    return path


def driven(path: Path, *odom_T_scans: np.ndarray, from_ns: int = 0) -> Path:
    """A bag of one scan again and again, a tenth of a second apart, with these poses by
    odometry."""
    points_m, _ = scan()
    with BagWriter(path, "mcap") as bag:
        for i, odom_T_scan in enumerate(odom_T_scans):
            stamp_ns = UTIME * 1000 + from_ns + i * 10**8
            for around_ns in (-(10**7), 10**7):
                bag.odometry(stamp_ns + around_ns, "odom", "base_link", odom_T_scan, "/wheels")
            cloud(bag, stamp_ns, "base_link", points_m)
    return path


def near(found: dict[str, float]) -> bool:
    """Whether a fix is at the true pose of `scan()`."""
    x_m, y_m = scan()[1][:2, 3]
    return bool(np.hypot(found["x"] - x_m, found["y"] - y_m) < 0.1)


def test_a_fix_is_printed_as_a_line_or_as_json(localize: Command, tmp_path: Path) -> None:
    line, reported = localize.run(floats(tmp_path))
    assert line.startswith(f"{UTIME}.bin")
    assert " accepted " in line
    assert "1 scan: 1 accepted, 0 near, 0 ambiguous, 0 rejected, 0 no pose" in reported
    found = json.loads(localize.run(tmp_path, "--json")[0])
    assert list(found) == [*COLUMNS, "covariance", "runners_up"]
    assert near(found)
    assert found["stamp"] == UTIME / 1e6
    assert np.array(found["covariance"]).shape == (6, 6)


def test_what_is_kept_instead_of_the_wanted_precision_is_said_once_and_stands_in_each_fix(
    localize: Command, tmp_path: Path
) -> None:
    for name in ("1.bin", "2.bin"):
        floats(tmp_path, name)
    lines, reported = localize.run(tmp_path, "--json", "--target-precision", 0.999)
    fixes = [json.loads(line) for line in lines.splitlines()]
    assert [(fix["verdict"], fix["target_precision"]) for fix in fixes] == 2 * [("accepted", 0.99)]
    words = "this site can keep .99, not .999: accepted means .99 (--strict refuses instead)"
    assert reported.count(words) == 1
    _, reported = localize.run(tmp_path, "--json", "--strict")
    assert "can keep" not in reported


def test_a_prior_is_searched_first_and_a_wrong_one_changes_no_answer(
    localize: Command, tmp_path: Path
) -> None:
    file = floats(tmp_path)
    x_m, y_m = scan()[1][:2, 3]
    for prior in (f"{x_m + 3},{y_m}", f"{x_m - 900},{y_m},90"):
        for track in ((), ("--track",)):
            words = (f"--prior={prior}", "--prior-sigma", "3", "--json", *track)
            assert near(json.loads(localize.run(file, *words)[0]))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--prior=1,2,3,4",), "--prior=1,2,3,4: expected x,y or x,y,heading"),
        (("--prior=x,2",), "--prior=x,2: expected x,y or x,y,heading"),
        (("--prior=1,inf",), "not finite"),
        (
            ("--prior=1,2", "--prior-sigma=3,4"),
            "--prior-sigma=3,4: expected METRES, since --prior has no heading",
        ),
        (("--prior=1,2,3", "--prior-sigma=3,0"), "expected more than 0"),
        (("--prior-sigma=3",), "--prior-sigma=3: needs --prior"),
    ],
)
def test_a_prior_that_is_none_is_refused_in_a_line(
    localize: Command, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    assert says in localize.refused(floats(tmp_path), *words)


def test_scan_files_of_every_format_are_read(localize: Command, tmp_path: Path) -> None:
    points_m, _ = scan()
    np.save(tmp_path / "1.npy", points_m.astype(np.float32))
    near_m = points_m[(np.abs(points_m) < 90).all(axis=1)]
    data = nclt.encode(near_m, np.zeros(len(near_m)), np.arange(len(near_m)) % 32)
    (tmp_path / "2.bin").write_bytes(data)
    (tmp_path / "3.pcd").write_bytes(pcd.encode(points_m))
    lines = localize.run(tmp_path, "--json")[0].splitlines()
    assert [json.loads(line)["name"] for line in lines] == ["1.npy", "2.bin", "3.pcd"]
    assert all(near(json.loads(line)) and json.loads(line)["stamp"] is None for line in lines)


def test_a_scan_is_read_from_standard_input(
    localize: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(floats(tmp_path).read_bytes())))
    assert near(json.loads(localize.run("-", "--json")[0]))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_the_points_of_a_bag_are_placed_by_its_transforms(
    localize: Command, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / ("day.bag" if kind == "ros1" else "day")
    points_m = seen_from(scan()[0], BODY_T_LIDAR)
    with BagWriter(path, kind) as bag:
        bag.static_transform(UTIME * 1000, "base_link", "lidar", BODY_T_LIDAR)
        for i in range(2):
            cloud(bag, UTIME * 1000 + i * 10**8, "lidar", points_m)
    first, second = map(json.loads, localize.run(path, "--json")[0].splitlines())
    assert near(first)
    assert near(second)
    assert second["stamp"] - first["stamp"] == pytest.approx(0.1, abs=1e-6)
    assert "--topic /other: " in localize.refused(path, "--topic", "/other")


def test_a_bag_is_followed_by_its_odometry(localize: Command, tmp_path: Path) -> None:
    path = driven(tmp_path / "day", *(planar(5, i, 0) for i in range(3)))
    reported = localize.run(path, "--track", "--odometry", "/wheels")[1]
    assert "tracked by odometry over 2 steps, by constant motion over 1" in reported
    assert "the site is simulated" in reported
    assert "by constant motion over 3" in localize.run(path, "--track")[1]
    kept = tmp_path / "kept.csv"
    kept.write_text("an older file")
    assert "--odometry /feet: " in localize.refused(
        path, "--track", "--odometry", "/feet", "--csv", "-o", kept
    )
    assert kept.read_text() == "an older file"
    assert "needs --track" in localize.refused(path, "--odometry", "/wheels")


@pytest.mark.parametrize("command", ["localize", "watch"])
def test_clouds_that_a_bag_leaves_out_are_counted(
    three_places: Path, tmp_path: Path, yearloc: Command, command: str
) -> None:
    """Its driver stamps in whole seconds: three of five clouds repeat the stamp of an earlier
    one."""
    points_m, _ = scan()
    with BagWriter(tmp_path / "day", "mcap") as bag:
        for i in range(5):
            cloud(bag, (1000 + i // 3) * 10**9, "base_link", points_m)
    options = ["--save", tmp_path / "a.mcap"] if command == "watch" else []
    _, reported = yearloc.run(command, three_places, tmp_path / "day", *options)
    assert "2 scans: 2 accepted" in reported
    assert "3 more were left out: stamp of an earlier one (3)" in reported


def test_the_odometry_of_another_recording_starts_again(localize: Command, tmp_path: Path) -> None:
    first = driven(tmp_path / "days/a", *[planar(5, 0, 0)] * 3)
    onwards = driven(tmp_path / "b", *[planar(5, 0, 0)] * 3, from_ns=3 * 10**8)
    later = driven(tmp_path / "days/c", *[planar(90, 0, 180)] * 3, from_ns=10**12)
    track = ("--track", "--odometry", "/wheels")
    two_drives = "by odometry over 4 steps, by constant motion over 2"
    reported = localize.run(first, later, *track)[1]
    assert "6 accepted" in reported
    assert two_drives in reported
    assert two_drives in localize.run(tmp_path / "days", *track)[1]
    # one drive, in two files
    reported = localize.run(first, onwards, *track)[1]
    assert "by odometry over 5 steps, by constant motion over 1" in reported


def test_odometry_that_jumps_gives_no_step_there(localize: Command, tmp_path: Path) -> None:
    """A robot stands for nine scans, and its odometry jumps by 85 m at the fifth."""
    path = driven(tmp_path / "day", *(planar(5 if i < 4 else 90, 0, 0) for i in range(9)))
    reported = localize.run(path, "--track", "--odometry", "/wheels")[1]
    assert "9 accepted" in reported
    # no step leads to the first scan, nor to the fifth, nor on from it
    assert "by odometry over 6 steps, by constant motion over 3" in reported


def test_fixes_are_written_as_csv_tum_and_mcap(localize: Command, tmp_path: Path) -> None:
    path = floats(tmp_path)
    np.save(tmp_path / "2.npy", np.ones((20, 3), np.float32))  # has no pose
    header, *rows = localize.run(tmp_path, "--csv")[0].splitlines()
    assert header.split(",") == list(COLUMNS)
    assert len(rows) == 2
    localize.run(path, "--tum", "-o", tmp_path / "poses.txt")
    stamp, *numbers = (tmp_path / "poses.txt").read_text().split()
    assert stamp == "1326652795.280148000"
    assert len(numbers) == 7
    assert "TUM trajectory" in inspect(tmp_path / "poses.txt").headline
    localize.run(path, "--mcap", "-o", tmp_path / "fixes.mcap")
    bag = BagFile(tmp_path / "fixes.mcap")
    assert (bag.topics["/fix"].kind, bag.topics["/fix"].count) == (POSE_COVARIANCE, 1)
    message = bag.decode(bag.first("/fix") or b"", POSE_COVARIANCE)
    assert near({"x": message.pose.pose.position.x, "y": message.pose.pose.position.y})
    assert "--mcap: expected -o FILE.mcap" in localize.refused(path, "--mcap")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["localize", "--mcap", "-o"], "a.mcap"),
        (["watch", "--save"], "a.mcap"),
        (["watch", "--save"], "a.rrd"),
    ],
)
def test_an_interrupted_command_leaves_an_older_file_as_it_was(
    three_places: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], name: str
) -> None:
    out = tmp_path / name
    out.write_text("an older file")
    scan_file = str(floats(tmp_path))

    def cut(path: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(replacing, "_fsync", cut)
    with pytest.raises(SystemExit):
        main([words[0], str(three_places), scan_file, *words[1:], str(out)])
    assert out.read_text() == "an older file"


def test_a_broken_scan_among_others_is_left_out_and_counted(
    localize: Command, tmp_path: Path
) -> None:
    floats(tmp_path)
    (tmp_path / "2.npy").write_bytes(b"\x93NUMPY")
    _, reported = localize.run(tmp_path)
    assert f"1 scans could not be read, the first: {tmp_path}/2.npy: no whole .npy" in reported
    assert "no whole .npy file" in localize.refused(tmp_path / "2.npy")


def test_a_sensor_at_another_height_is_reported_with_how_to_raise_its_points(
    localize: Command, tmp_path: Path
) -> None:
    points_m, _ = scan()
    np.save(tmp_path / "1.npy", points_m - (0, 0, 1.73))
    reported = localize.run(tmp_path / "1.npy")[1]
    assert (
        "unlike the scans that the site was learned with: the ground lies at z = -1.7" in reported
    )
    assert "--lift 1.7" in reported
    # whatever was given, the whole lift is named
    assert "with --lift 1.7" in localize.run(tmp_path / "1.npy", "--lift", 3.0)[1]
    assert near(json.loads(localize.run(tmp_path / "1.npy", "--lift", 1.73, "--json")[0]))


def test_a_log_of_the_sites_data_set_is_raised_by_its_reader_only(
    localize: Command, tmp_path: Path
) -> None:
    points_m = scan()[0] - (0, 0, 1.73)
    near_m = points_m[(np.abs(points_m) < 90).all(axis=1)]
    (tmp_path / "day/velodyne_sync").mkdir(parents=True)
    data = nclt.encode(near_m, np.zeros(len(near_m)), np.arange(len(near_m)) % 32)
    (tmp_path / f"day/velodyne_sync/{UTIME}.bin").write_bytes(data)
    poses = [f"{UTIME + late},0,0,0,0,0,0\n" for late in (-100_000, 100_000)]
    (tmp_path / "day/groundtruth_day.csv").write_text("".join(poses))
    said = localize.refused(tmp_path / "day", "--lift", 1.73)
    says = "is a log of the site's data set, whose reader raises its points"
    assert f"--lift 1.73: {tmp_path}/day {says}" in said
    reported = localize.run(tmp_path / "day")[1]
    assert "not 0: it would with +1.72 m more of reader.lift_m" in reported


@pytest.mark.parametrize(
    ("rpy_deg", "says", "turn"),
    [
        ((10, 0, 0), "tilted by about 10°", "-10.0,0.0,0.0"),
        ((0, -20, 0), "tilted by about 20°", "0.0,20.0,0.0"),
        ((180, 0, 0), "upside down", "180.0,0.0,0.0"),
        ((190, 0, 0), "upside down and tilted by about 10°", "170.0,0.0,0.0"),
    ],
)
def test_a_scan_that_leans_is_reported_with_how_to_turn_it(
    localize: Command, tmp_path: Path, rpy_deg: tuple[float, ...], says: str, turn: str
) -> None:
    """A lidar is mounted 1.5 m over the ground, turned by roll, pitch and yaw."""
    lidar_T_level = pose(np.zeros((1, 3)), np.radians([rpy_deg]))[0]
    points_m = (scan()[0] - (0, 0, 1.5)) @ lidar_T_level[:3, :3].T
    np.save(tmp_path / "1.npy", points_m)
    reported = localize.run(tmp_path / "1.npy")[1]
    assert f"{says}: it would stand upright with" in reported
    assert "the ground lies" not in reported
    (option,) = [word for word in reported.split() if word.startswith("--body-T-lidar=")]
    given_deg = np.array([float(word) for word in option.partition("=")[2].split(",")])
    wanted_deg = np.array([float(word) for word in turn.split(",")])
    off_deg = (given_deg[3:] - wanted_deg + 180) % 360 - 180
    assert np.abs(off_deg).max() < 1
    assert given_deg[2] == pytest.approx(1.5, abs=0.1)
    line, reported = localize.run(tmp_path / "1.npy", option, "--json")
    assert json.loads(line)["verdict"] == "accepted"
    assert "upright" not in reported


def test_level_scans_of_other_places_do_not_lean() -> None:
    assert [lean(scene(seed) - (0, 0, 1.5)) for seed in range(5)] == [None] * 5


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["1.bin", "--body-T-lidar", "0,0,1"],
            "--body-T-lidar=0,0,1: expected x,y,z,roll,pitch,yaw in metres and degrees",
        ),
        (["none"], "none: no such file or folder"),
        (["."], "no scan there"),
        (
            ["1.bin", "--target-precision", "0.999", "--strict"],
            "target_precision=0.999: this site has no threshold for it; it has thresholds for 0.95, 0.99",
        ),
        (
            ["1.bin", "--target-precision", "99"],
            "target_precision=99: expected a share above 0 and at most 1, such as 0.99",
        ),
        (["1.bin", "-o", "nowhere/x.csv"], "nowhere/x.csv: no folder nowhere"),
        (["1.bin", "-o", "empty"], "empty: is a folder, expected a file"),
        (["1.bin", "-o", "/proc/x.csv"], "/x.csv: cannot be written (no such file or directory)"),
        (["1.bin", "--mcap", "-o", "/proc/x.mcap"], "/proc/x.mcap: cannot be written"),
        (["1.bin", "--mcap", "-o", "/dev/null"], "/dev/null: is not a regular file"),
        (["1.bin", "--threads", "0"], "--threads 0: expected at least 1"),
    ],
)
def test_wrong_arguments_are_refused_in_a_line(
    localize: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    if words[0] == "1.bin":
        floats(tmp_path, "1.bin")
    assert says in localize.refused(*([tmp_path / "empty"] if words == ["."] else words))


def test_the_lines_of_the_tutorial_run(
    localize: Command, three_places: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("campus.site").symlink_to(three_places)
    np.save("scan.npy", scan()[0])
    page = (Path(__file__).parents[2] / "docs/tutorials/robot.md").read_text()
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    printed = localize.capsys.readouterr().out
    fix = json.loads(localize.run("scan.npy", "--json")[0])
    assert printed.startswith(f"{fix['place']} [[")
