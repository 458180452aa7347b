"""Tests the RobotCar reader on files made by hand.

Expected numbers come from METHODS 7.2; some tests are on errors that the data set's SDK makes.
"""

from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import NED_FLIP, rpy, yaw
from pipeline.readers.log import Log
from pipeline.readers.robotcar import RobotCar, read_sweep
from pipeline.readers.robotcar_poses import read_extrinsics, read_vo
from tests.readers.damage import one_line
from tests.readers.robotcar_drive import (
    DATE,
    FRONT,
    INS,
    INS_HEADER,
    REAR,
    SEEN,
    START,
    VO_HEADER,
    ZERO,
    drive,
    ins_row,
    ins_text,
    sweep,
    vo_row,
    vo_text,
)

BOTH = RobotCar(("lms_front", "lms_rear"))
ONE = sweep((1, 0, 7))


def opened(root: Path, **files: Any) -> Log:
    """Open a drive that is written with these files."""
    return RobotCar().open(drive(root, **files), DATE)


def ms(log: Log) -> list[float]:
    """Stamps in milliseconds after START."""
    return ((log.stamps_ns // 1000 - START) / 1000).tolist()


def x(poses: np.ndarray) -> list[float | None]:
    """The x of each pose; None where it is unknown."""
    return [None if np.isnan(pose).all() else round(float(pose[0, 3]), 9) for pose in poses]


def chained(*steps: tuple[float, float, float]) -> str:
    """A vo.csv of motions ahead: when they end and begin in ms after START, and their metres."""
    return vo_text(*(vo_row(end_ms, start_ms, ahead_m) for end_ms, start_ms, ahead_m in steps))


def driven_with_outages(times_ms: Iterable[int], bad_ms: Container[int], bad_status: str) -> str:
    """An ins.csv of 10 m/s northwards, whose rows at `bad_ms` have a bad status."""
    statuses = {True: bad_status, False: "INS_SOLUTION_GOOD"}
    return ins_text(*(ins_row(t, t / 100, status=statuses[t in bad_ms]) for t in times_ms))


# Sweeps


@pytest.mark.parametrize(
    ("laser", "beam", "vehicle"),
    [
        ("lms_front", (1, 0), (1.872180, 0.230834, 2.034655)),
        ("lms_front", (0, 1), (1.766719, 1.226757, 1.036148)),
        ("lms_rear", (1, 0), (-2.527232, 0.263364, 2.086591)),
        ("lms_rear", (0, 1), (-2.645800, -0.712782, 1.070185)),
    ],
)
def test_a_return_lies_where_the_extrinsics_say(
    tmp_path: Path, laser: str, beam: tuple, vehicle: tuple
) -> None:
    # METHODS 7.2, in the z-down vehicle; handed out are y left and z up.
    root = drive(tmp_path, {50: sweep((*beam, 9))}, rear={50: sweep((*beam, 9))})
    log = RobotCar([laser], lift_m=1.5).open(root, DATE)
    x_m, right_m, down_m = vehicle
    np.testing.assert_allclose(log.points(0), [[x_m, -right_m, 1.5 - down_m]], atol=1e-6)


def test_beams_without_a_return_are_dropped_and_sweeps_may_be_short(tmp_path: Path) -> None:
    # Kept are (2, 0) and (0, −3); a reflectance that is no number does not matter.
    beams = [(0, 0, 5), (2, 0, np.nan), (np.nan, 1, 5), (1, np.inf, 5), (0, -3, 0), (-0.0, 0, 5)]
    path = tmp_path / "1.bin"
    path.write_bytes(sweep(*beams, (0.004, 1e-320, 5)))
    np.testing.assert_array_equal(read_sweep(path, np.eye(4)), [[2, 0, 0], [0, -3, 0]])
    path.write_bytes(sweep((0, 0, 0)))
    assert read_sweep(path, np.eye(4)).shape == (0, 3)


def test_both_lasers_are_merged_in_order_of_time(tmp_path: Path) -> None:
    # The front sweeps at 20 and 60 ms, the rear at 40 and 60 ms: one row holds both sweeps of one
    # stamp.
    log = BOTH.open(drive(tmp_path, {20: ONE, 60: ONE}, rear={40: ONE, 60: ONE}), DATE)
    front = (1.872180, -0.230834, -2.034655)
    rear = (-2.527232, -0.263364, -2.086591)
    assert ms(log) == [20, 40, 60]
    for row, points in enumerate(([front], [rear], [front, rear])):
        np.testing.assert_allclose(log.points(row), points, atol=1e-6)


def test_a_sweep_is_paired_with_its_stamp_by_name_not_by_position(tmp_path: Path) -> None:
    # Stamps of 10, 20, 30, 40 ms; the file of 20 is lost and one of 35 has no stamp. By position
    # (the SDK's bug, issue 33) the file of 30 would be taken for 20's.
    stamps = "".join(f"{START + 10_000 * i} 1\n" for i in (1, 2, 3, 4))
    sweeps = {t: sweep((t, 0, 0)) for t in (10, 30, 35, 40)}
    log = opened(tmp_path, sweeps=sweeps, stamps=stamps, extrinsics={"lms_front": ZERO})
    assert ms(log) == [10, 30, 40]
    assert [log.points(row)[0, 0] for row in range(3)] == [10, 30, 40]
    np.testing.assert_allclose(log.odom_T_scan[:, 0, 3], [0.1, 0.3, 0.4])
    assert log.skipped == {"stamp without a file": 1, "file without a stamp": 1}


def test_without_a_list_of_stamps_all_files_are_read(tmp_path: Path) -> None:
    log = opened(tmp_path, stamps=None)
    assert ms(log) == [50 + 100 * i for i in range(10)]
    assert log.notes == (
        "no lms_front.timestamps: the sweeps of lms_front are those whose files are there",
    )


def test_files_that_are_no_sweeps_are_counted(tmp_path: Path) -> None:
    root = drive(tmp_path, {50: ONE, 60: b"", 70: ONE[:-1]})
    folder = root / DATE / "lms_front"
    for name in ("sweep.bin", f"0{START}.bin", "-5.bin", "9" * 19 + ".bin", "٣.bin", "readme.txt"):
        (folder / name).write_bytes(ONE)
    (folder / f"{START + 80_000}.bin").mkdir()
    log = RobotCar().open(root, DATE)
    assert ms(log) == [50]
    assert log.skipped == {"file name is no utime": 5, "empty file": 2, "truncated record": 1}


def test_opening_reads_no_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = drive(tmp_path)
    read = []
    whole = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: (read.append(path.name), whole(path))[1])
    log = RobotCar().open(root, DATE)
    assert not read
    log.points(3)
    assert read == [f"{START + 350_000}.bin"]


# Visual odometry


def test_odometry_is_chained_and_interpolated(tmp_path: Path) -> None:
    # METHODS 7.2: +1 m at 100 and 200 ms: 1.5 m at 150 ms (integer division, the SDK's bug, gives 1
    # m), −0.5 m from 200 ms.
    vo = chained((100, 0, 1.0), (200, 100, 1.0))
    log = opened(tmp_path, sweeps={150: ONE, 200: ONE}, vo=vo)
    assert x(log.odom_T_scan) == [1.5, 2]
    assert (np.linalg.inv(log.odom_T_scan[1]) @ log.odom_T_scan[0])[0, 3] == pytest.approx(-0.5)


def test_the_first_knot_is_the_first_rows_destination_at_its_own_time(tmp_path: Path) -> None:
    # The SDK gives it time 0 where the window starts at the first row: every pose before 100 ms
    # would then be about 1 m.
    path = tmp_path / "vo.csv"
    path.write_text(vo_text(vo_row(100, 0, 1.0)))
    knots = read_vo(path, 0.5).trajectory
    assert knots.stamps_ns.tolist() == [START * 1000, (START + 100_000) * 1000]
    np.testing.assert_array_equal(knots.world_T_body[0], np.eye(4))


def test_no_sweep_gets_odometry_beyond_either_end(tmp_path: Path) -> None:
    # Knots from 0 to 200 ms. The SDK clamps to the end, or extrapolates.
    sweeps = dict.fromkeys((-0.002, 0, 200, 200.002), ONE)
    ins = ins_text(*(ins_row(t) for t in range(-100, 400, 100)))
    log = opened(tmp_path, sweeps=sweeps, vo=chained((100, 0, 1.0), (200, 100, 1.0)), ins=ins)
    assert x(log.odom_T_scan) == [None, 0, 2, None]
    assert x(log.world_T_scan) == [0, 0, 0, 0]


def test_a_row_is_motion_in_the_frame_of_the_vehicle_before(tmp_path: Path) -> None:
    # 1 m ahead and a quarter turn to the right (clockwise, seen from above: positive about z down),
    # then 2 m ahead: from the start 1 m ahead and 2 m right, y = −2, heading −90°.
    vo = vo_text(vo_row(100, 0, 1, 0, 0, 0, 0, np.pi / 2), vo_row(200, 100, 2.0))
    log = opened(tmp_path, sweeps={50: ONE, 200: ONE}, vo=vo)
    np.testing.assert_allclose(log.odom_T_scan[1, :3, 3], [1, -2, 0], atol=1e-12)
    # halfway through the turn by slerp
    np.testing.assert_allclose(np.rad2deg(yaw(log.odom_T_scan)), [-45, -90])


def test_a_wide_step_is_a_gap(tmp_path: Path) -> None:
    vo = chained((100, 0, 1.0), (700, 100, 6.0), (800, 700, 1.0))
    log = opened(tmp_path, sweeps=dict.fromkeys((50, 400, 750), ONE), vo=vo)
    assert x(log.odom_T_scan) == [0.5, None, 7.5]
    assert x(RobotCar(max_vo_gap_s=0.6).open(tmp_path, DATE).odom_T_scan) == [0.5, 4, 7.5]


def test_sweeps_within_a_break_have_no_odometry(tmp_path: Path) -> None:
    # The chain ends at 200 ms, the next row starts at 400: again, from the identity.
    vo = chained((100, 0, 1.0), (200, 100, 1.0), (500, 400, 1.0), (600, 500, 1.0))
    log = opened(tmp_path, sweeps=dict.fromkeys((150, 200, 250, 350, 400, 550), ONE), vo=vo)
    assert x(log.odom_T_scan) == [1.5, 2, None, None, 0, 1.5]
    assert x(log.world_T_scan) == [1.5, 2, 2.5, 3.5, 4, 5.5]
    assert log.notes == ("the visual odometry breaks off 1 times: no submap reaches across",)


@pytest.mark.parametrize("before", [201, 100])
def test_the_first_sweep_after_a_break_has_no_odometry(tmp_path: Path, before: int) -> None:
    # The third row starts 1 ms after the second ended, or back at 100 ms: then the new chain has
    # its first knot at 300 ms.
    vo = chained((100, 0, 1.0), (200, 100, 1.0), (300, before, 1.0), (400, 300, 1.0))
    log = opened(tmp_path, sweeps=dict.fromkeys((150, 350, 400), ONE), vo=vo)
    assert x(log.odom_T_scan)[:2] == [1.5, None]
    np.testing.assert_allclose(log.odom_T_scan[2, 0, 3], 2 if before == 201 else 1)
    assert x(log.world_T_scan) == [1.5, 3.5, 4]


def test_a_break_in_an_outage_is_marked_at_the_first_sweep_with_a_true_pose(tmp_path: Path) -> None:
    # Broken at 200 ms, without a true pose from 150 to 450 ms: sweeps of the new chain go up to the
    # first with a true pose, which marks the break. Without it, a submap would join two chains.
    again = [(t + 100, t, 1.0) for t in range(250, 750, 100)]
    vo = chained((100, 0, 1.0), (200, 100, 1.0), *again)
    ins = driven_with_outages(range(0, 1000, 50), range(150, 451), "INS_BAD_GPS_AGREEMENT")
    log = opened(tmp_path, sweeps=dict.fromkeys((50, 175, 275, 375, 525, 575), ONE), vo=vo, ins=ins)
    assert ms(log) == [50, 175, 525, 575]
    assert x(log.odom_T_scan) == [0.5, 1.75, None, 3.25]
    assert x(log.world_T_scan) == [0.5, None, 5.25, 5.75]
    assert log.skipped == {"neither odometry nor a true pose": 2}


# Inertial navigation


def test_the_true_pose_is_the_vehicles_not_the_ins_units(tmp_path: Path) -> None:
    # METHODS 7.2: inv(ins) · front translates by (3.475969, 0.091515, −0.013567): where the front
    # laser is, seen from the INS.
    ins = ins_text(ins_row(0), ins_row(100))
    log = opened(tmp_path, sweeps={50: ONE}, ins=ins, extrinsics={"ins": INS})
    laser = log.world_T_scan[0] @ (1.7589, -0.2268, -1.0411, 1)
    np.testing.assert_allclose(laser[:3], [3.475969, -0.091515, 0.013567], atol=1e-6)


def test_northing_easting_down_become_north_west_up(tmp_path: Path) -> None:
    # Heading 0.3 clockwise from north; left and up change sign, so do pitch and yaw.
    place = (5_735_000.5, 620_000.25, -110.0, 0.1, 0.2, 0.3)
    log = opened(tmp_path, sweeps={50: ONE}, ins=ins_text(ins_row(0, *place), ins_row(100, *place)))
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [5_735_000.5, -620_000.25, 110.0])
    np.testing.assert_allclose(rpy(log.world_T_scan), [[0.1, -0.2, -0.3]], atol=1e-12)


def test_a_sweep_in_an_outage_keeps_its_odometry_but_has_no_place(tmp_path: Path) -> None:
    # Bad rows at 200 and 300 ms: nothing is known between 100 and 400 ms. A hole of 600 ms from 500
    # to 1100 ms is one too.
    times_ms = (0, 100, 200, 300, 400, 500, 1100, 1200)
    ins = driven_with_outages(times_ms, (200, 300), "INS_SOLUTION_NOT_GOOD")
    log = opened(tmp_path, ins=ins)
    assert x(log.world_T_scan) == [0.5, None, None, None, 4.5, None, None, None, None, None]
    assert x(log.odom_T_scan) == [0.5 + i for i in range(10)]
    assert log.notes == ("8 of 10 sweeps have no place (INS outages: 2)",)
    assert not log.skipped


def test_a_good_row_that_is_no_number_is_an_outage_and_a_sweep_of_neither_pose_is_dropped(
    tmp_path: Path,
) -> None:
    ins = ins_text(ins_row(0), ins_row(100), ins_row(200, np.nan))
    log = opened(tmp_path, sweeps=dict.fromkeys((-10, 50, 150, 1001), ONE), ins=ins)
    assert ms(log) == [50, 150]
    assert x(log.world_T_scan) == [0, None]
    assert log.skipped == {"neither odometry nor a true pose": 2}


def test_two_utm_zones_share_no_frame(tmp_path: Path) -> None:
    rows = [ins_row(0), ins_row(50, zone="31U", status="INS_INACTIVE"), ins_row(100)]
    opened(tmp_path / "one", ins=ins_text(*rows))  # only good rows count
    with pytest.raises(LogError, match="UTM zones 30U, 31U"):
        opened(tmp_path / "two", ins=ins_text(*rows, ins_row(150, zone="31U")))


# Tables


def test_columns_are_found_by_name(tmp_path: Path) -> None:
    lines = (INS_HEADER, ins_row(0, 1, 2, 3, 0.1, 0.2, 0.3), ins_row(100, 1))
    turned = "".join(",".join(line.strip().split(",")[::-1]) + "\r\n" for line in lines)
    log = opened(tmp_path, sweeps={0: ONE}, ins="\ufeff" + turned + "\r\n")
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1, -2, -3])


def twice(row: str) -> str:
    """A vo.csv with a good row before `row`."""
    return vo_text(vo_row(100, 0, 1.0), row)


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({"vo": None}, r"vo\.csv: no such file"),
        ({"vo": ""}, r"vo\.csv: its first line names no column source_timestamp, dest"),
        ({"vo": VO_HEADER}, r"vo\.csv: holds no rows"),
        (
            {"vo": VO_HEADER.replace(",yaw", ",heading") + vo_row(100, 0)},
            r"vo\.csv: its first line names no column yaw;",
        ),
        ({"vo": twice("1,2,3\n")}, "row 2 has 3 columns of 8"),
        (
            {"vo": twice(vo_row(200, 100).replace("0.0\n", "ahead\n"))},
            "row 2 has yaw 'ahead'; expected a number",
        ),
        ({"vo": twice(vo_row(200, 100, np.nan))}, "row 2 holds no pose"),
        (
            {"vo": twice(vo_row(100, 200))},
            "row 2 goes from destination_timestamp 1405349390200000 to source_timestamp",
        ),
        ({"vo": twice(vo_row(50, 0))}, "row 2 is stamped"),  # backwards
        ({"vo": b"\xff\xfe\x00" * 9}, r"vo\.csv: expected a csv file"),
        (
            {"ins": SEEN.replace("utm_zone", "zone")},
            r"ins\.csv: its first line names no column utm_zone;",
        ),
        ({"ins": ins_text(ins_row(0), ins_row(100), ins_row(50))}, "row 3 is stamped"),
        (
            {"ins": ins_text(ins_row(0)) + "1405349390000000.5" + ins_row(0)[16:]},
            "row 2 is stamped .*expected whole µs",
        ),
        ({"ins": SEEN[:-30]}, "row 51 has"),
        (
            {"stamps": f"{START + 50_000} 1\n{START} 1\n"},
            r"lms_front\.timestamps: row 2 is stamped",
        ),
        ({"stamps": f"{START + 50_000}\n"}, r"lms_front\.timestamps: expected 2 numbers"),
        ({"stamps": "1 1\n"}, "lms_front: holds no readable sweep"),
        ({"sweeps": {}}, r"lms_front\.timestamps"),
        ({"extrinsics": {"ins": "0 0 0\n"}}, r"ins\.txt: expected 6 numbers"),
        ({"extrinsics": {"lms_front": ZERO * 2}}, r"lms_front\.txt: expected one row of six"),
        ({"extrinsics": {"lms_front": "nan 0 0 0 0 0"}}, r"front\.txt: expected one row of six"),
    ],
)
def test_a_broken_drive_raises_an_error_of_one_line(
    tmp_path: Path, files: dict[str, Any], says: str
) -> None:
    with one_line(LogError, says):
        opened(tmp_path, **files)


def test_the_error_on_missing_extrinsics_says_where_to_take_them_from(tmp_path: Path) -> None:
    root = drive(tmp_path)
    (root / "extrinsics" / "ins.txt").unlink()
    says = r"extrinsics/ins\.txt: no such file; copy the folder `extrinsics` of the .*SDK"
    with pytest.raises(LogError, match=says):
        RobotCar().open(root, DATE)
    (root / "extrinsics").rename(root / "sdk")
    with pytest.raises(LogError, match="lms_front"):
        RobotCar().open(root, DATE)
    (root / "sdk" / "ins.txt").write_text(ZERO)
    assert len(RobotCar(extrinsics="sdk").open(root, DATE).stamps_ns) == 10
    (root / "sdk").rename(root / DATE / "sdk")
    assert RobotCar(extrinsics="{sequence}/sdk").sequences(root) == {DATE: []}
    assert len(RobotCar(extrinsics="{sequence}/sdk").open(root, DATE).stamps_ns) == 10


def test_the_real_extrinsics_are_the_published_ones(real: Path) -> None:
    folder = real / "robotcar" / "extrinsics"
    for sensor, text in (("lms_front", FRONT), ("lms_rear", REAR), ("ins", INS)):
        published = (folder / f"{sensor}.txt").read_text()
        assert [*map(float, published.split())] == [*map(float, text.split())]
    np.testing.assert_array_equal(read_extrinsics(folder, "stereo"), np.eye(4))
    front = read_extrinsics(folder, "lms_front")
    rear = read_extrinsics(folder, "lms_rear")
    ahead = front @ (1, 0, 0, 1)
    aside = rear @ (0, 1, 0, 1)
    np.testing.assert_allclose(ahead[:3], [1.872180, 0.230834, 2.034655], atol=1e-6)
    np.testing.assert_allclose(aside[:3], [-2.645800, -0.712782, 1.070185], atol=1e-6)
    ins_T_front = np.linalg.inv(read_extrinsics(folder, "ins")) @ front
    np.testing.assert_allclose(ins_T_front[:3, 3], [3.475969, 0.091515, -0.013567], atol=1e-6)
    # The lasers scan across the road, not along it: the front one's plane has its normal within 15°
    # of forward.
    assert abs((NED_FLIP @ front)[0, 2]) > np.cos(np.radians(15))


def test_sequences_are_listed_with_what_they_lack(tmp_path: Path) -> None:
    root = drive(tmp_path)
    (root / "2014-11-25-09-18-32" / "lms_rear").mkdir(parents=True)
    (root / "else").mkdir()
    (root / "extrinsics" / "lms_rear.txt").unlink()
    other = "2014-11-25-09-18-32"
    lacks = [f"{other}/lms_front", f"{other}/vo/vo.csv", f"{other}/gps/ins.csv"]
    assert RobotCar().sequences(root) == {DATE: [], other: lacks}
    assert BOTH.sequences(root)[DATE] == [f"{DATE}/lms_rear", "extrinsics/lms_rear.txt"]
    with one_line(LogError, r"2015-01-01.*no such folder of sweeps"):
        RobotCar().open(root, "2015-01-01-00-00-00")
