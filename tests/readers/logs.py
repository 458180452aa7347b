"""Writes small logs by hand, in the formats of the data sets: NCLT, KITTI, CARMEN, a user's own.

Without arguments each is a whole log; an argument replaces the content of a file, and None leaves
the file out.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

DATE = "2012-01-08"
START = 1_326_030_975_000_000  # µs: 2012-01-08 13:56:15 UTC
TR = "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0"  # camera x = −left, y = −up, z = forward


def sync_bytes(*hits: tuple[int, int, int]) -> bytes:
    """A velodyne_sync file of hits with raw x, y, z, each with intensity 7 and laser 3."""
    return b"".join(np.array(hit, "<u2").tobytes() + bytes([7, 3]) for hit in hits)


def packet(
    utime: int, *hits: tuple[int, int, int, int, int], magic: tuple[int, ...] = (44_444,) * 4
) -> bytes:
    """A packet of velodyne_hits.bin with hits of x, y, z, intensity, laser."""
    data = np.array(magic, "<u2").tobytes()
    data += np.array([len(hits)], "<u4").tobytes()
    data += np.array([utime], "<u8").tobytes()
    data += bytes(4)
    for hit in hits:
        data += np.array(hit[:3], "<u2").tobytes() + bytes(hit[3:])
    return data


def nclt_row(index: int, *pose: object) -> str:
    """A row of NCLT's poses: a tenth of a second and, without a `pose`, a metre north per row."""
    numbers = (START + 100_000 * index, *(pose or (index, 0, 0, 0, 0, 0)))
    return ", ".join(map(str, numbers)) + "\n"


def nclt_log(
    root: Path,
    ground_truth: str | None = "".join(
        f"{START + 100_000 * i}, {i}, 0, 0, 0, 0, 0\n" for i in range(11)
    ),
    scans: dict[str, bytes] | None = None,
    odometry: str | None = None,
) -> Path:
    """Write a sequence of NCLT, driven north at 10 m/s for one second.

    `scans` are the bytes of each file by its stem; by default one scan, after 0.15 s.
    """
    folder = root / DATE / "velodyne_sync"
    folder.mkdir(parents=True)
    if scans is None:
        scans = {str(START + 150_000): sync_bytes((20_200, 20_400, 19_600))}
    for stem, data in scans.items():
        (folder / f"{stem}.bin").write_bytes(data)
    if ground_truth is not None:
        (root / DATE / f"groundtruth_{DATE}.csv").write_text(ground_truth)
    if odometry is not None:
        (root / DATE / "odometry_mu_100hz.csv").write_text(odometry)
    return root


def kitti_log(
    root: Path,
    calib: str | None = f"P0: 1 0 0 0 0 1 0 0 0 0 1 0\n{TR}\n",
    poses: str | None = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {2 * i}\n" for i in range(6)),
    times: str | None = "".join(f"{0.1 * i:.6e}\n" for i in range(6)),
    scans: dict[str, bytes] | None = None,
) -> Path:
    """Write KITTI's log 07 with six poses, each two metres ahead of the one before.

    `scans` are the bytes of each file by its stem; by default scan i holds one point at (i, 1,
    −1.73) with reflectance 0.5.
    """
    log = root / "sequences" / "07"
    (log / "velodyne").mkdir(parents=True)
    (root / "poses").mkdir()
    if scans is None:
        scans = {f"{i:06d}": np.array([i, 1, -1.73, 0.5], "<f4").tobytes() for i in range(6)}
    for stem, data in scans.items():
        (log / "velodyne" / f"{stem}.bin").write_bytes(data)
    for path, text in (
        (log / "calib.txt", calib),
        (log / "times.txt", times),
        (root / "poses" / "07.txt", poses),
    ):
        if text is not None:
            path.write_text(text)
    return root


def folder_log(
    root: Path,
    poses: str | None = "".join(
        f"{START / 1e6 + 0.1 * i:.1f} {i} 0 0 0 0 0 1\n" for i in range(11)
    ),
    scans: dict[str, bytes] | None = None,
    times: str | None = None,
) -> Path:
    """Write the sequence of a user's robot, driven forward at 10 m/s for one second.

    `scans` are the bytes of each file by its name; by default one scan after 0.15 s, with one point
    at (2, 1, 3).
    """
    if scans is None:
        scans = {f"scans/{START // 10**6}.150.bin": np.array([2, 1, 3, 0.5], "<f4").tobytes()}
    for name, data in scans.items():
        (root / "drive" / name).parent.mkdir(parents=True, exist_ok=True)
        (root / "drive" / name).write_bytes(data)
    (root / "drive").mkdir(exist_ok=True)
    for name, text in (("poses.txt", poses), ("times.txt", times)):
        if text is not None:
            (root / "drive" / name).write_text(text)
    return root


def flaser(
    ranges_m: Sequence[float],
    robot: str,
    stamp: float | str,
    laser: str | None = None,
    kind: str = "FLASER",
) -> str:
    """A CARMEN record of one sweep; the poses of `robot` and `laser` are words x y heading."""
    return (
        f"{kind} {len(ranges_m)} {' '.join(map(str, ranges_m))} {laser or robot} {robot} {stamp} "
        f"robot {stamp}\n"
    )


def carmen_log(root: Path, stamps: bool = True, name: str = "drive.log") -> Path:
    """Write a corrected CARMEN log of six sweeps, a metre apart along x.

    From each to the next, the odometry says 1.5 m ahead and 0.25 m aside. Without `stamps`, the
    stamps of all sweeps are 0.
    """
    lines = ["# CARMEN\nPARAM robot_front_laser_max 50.0 1 host 1\n"]
    for i in range(6):
        lines.append(f"ODOM {i + 0.5} 0.25 0 1 0 0 {i} host {i}\n" if i else "")
        lines += [
            flaser([1, 2, 50], f"{i} 0 0", 10 + i if stamps else 0),
            f"ODOM {i} 0 0 1 0 0 {i} host {i}\n",
        ]
    root.mkdir(parents=True, exist_ok=True)
    (root / name).write_text("".join(lines))
    return root


def key_frames(root: Path) -> Path:
    """Write four key frames, a metre apart along −y and a second apart in time.

    Each cloud holds a point 2 m along −y.
    """
    folder = root / "run"
    folder.mkdir(parents=True)
    rows = []
    for i in range(4):
        poses = " ".join(f"{source} {-i} 0 0 0 0 1" for source in range(4))
        rows.append(f"{i} {100 + i} 0 1 1 {poses}\n")
        head = (
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT "
            "1\nPOINTS 1\nDATA ascii\n"
        )
        (folder / f"{i}.pcd").write_text(f"{head}0 -2 {i}\n")
    (folder / "keyframes.txt").write_text("".join(rows))
    return root
