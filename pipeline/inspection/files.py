"""Describes one file of points for `yearloc inspect`: a path in; rows of text and warnings out.

It is a .bin of NCLT, KITTI or another robot, the packets of velodyne_hits.bin, a PCD, or a .npy.
"""

from pathlib import Path

import numpy as np

from pipeline.core.errors import LogError
from pipeline.core.frames import flip_ned, pose, transformed
from pipeline.formats import bin_layout, folder, kitti, nclt, pcd
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, duration, moment, nbytes
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.nclt import read_packets, read_velodyne_sync

FORMATS = {"velodyne_sync": "nclt", "velodyne": "kitti"}
"""The format of a scan by the name of its folder."""
REVOLUTION_US = 100_000
"""Time in which NCLT's LiDAR turns once."""
MAX_UTIME_DIGITS = 17
"""A file name of more digits is no stamp in µs since 1970."""


def format_of(path: Path, as_format: str | None) -> str:
    """The format of a .bin or of a folder of them: nclt, kitti, or folder (another robot's).

    It is `as_format` if given; else the name of the folder says it, else the bytes of a file.
    """
    scans = path if path.is_dir() else path.parent
    if format_name := as_format or FORMATS.get(scans.name):
        return format_name
    example = next(iter(sorted(path.glob("*.bin"))), path) if path.is_dir() else path
    if not example.is_file():
        return "folder"
    width = bin_layout.point_bytes(example.read_bytes())
    return "nclt" if width == bin_layout.NCLT_BYTES else "folder"


def describe_scan_file(path: Path, as_format: str | None, inspection: Inspection) -> None:
    """Describe a .bin with one scan, or velodyne_hits.bin; raises LogError for a damaged one."""
    if path.name == nclt.PACKETS:
        _describe_packets(path, inspection)
        return
    describe_by_format = {
        "nclt": _describe_nclt_scan,
        "kitti": _describe_kitti_scan,
        "folder": describe_own_scan,
    }
    describe = describe_by_format[format_of(path, as_format)]
    if not path.stat().st_size:
        raise LogError(f"{path}: empty; expected records of one scan: fetch the file again")
    describe(path, inspection)


def _describe_nclt_scan(path: Path, inspection: Inspection) -> None:
    """Describe velodyne_sync/UTIME.bin, a scan of NCLT in the body frame, ground near z = 0."""
    points = read_velodyne_sync(path)
    # the fourth word of a hit: the intensity in its low byte, the laser's id in its high byte
    intensity_and_laser = np.fromfile(path, "<u2").reshape(-1, 4)[:, 3]
    intensity = intensity_and_laser & 0xFF
    lasers = (intensity_and_laser >> 8).astype(np.uint8)
    inspection.kind = "NCLT scan, motion compensated"
    inspection.add(
        "",
        ("size", f"{nbytes(path.stat().st_size)}, records of {nclt.RECORD_BYTES} bytes"),
        ("taken", moment_of(path)),
        ("intensity", f"{intensity.min()} … {intensity.max()}"),
        ("lasers", f"ids {lasers.min()} … {lasers.max()}"),
        (
            "frame",
            "body: x forward, y left, z up (the file's y right, z down, turned by the reader)",
        ),
    )
    wrong_format = (
        f"laser id {lasers.max()}: an HDL-32E has ids 0–31; is this file KITTI's? Then add "
        "--format kitti"
    )
    inspection.warn_if(lasers.max() >= bin_layout.LASERS, wrong_format)
    diagnose(points, lasers).add_to(inspection)


def _describe_kitti_scan(path: Path, inspection: Inspection) -> None:
    """Describe velodyne/NNNNNN.bin, a scan of KITTI, raised by the reader's default height."""
    height_m = Kitti().lidar_height_m
    size = path.stat().st_size
    points = read_velodyne(path, height_m)
    nonfinite_count = size // kitti.RECORD_BYTES - len(points)
    reflectance = np.fromfile(path, "<f4").reshape(-1, 4)[:, 3]
    inspection.kind = "KITTI scan"
    inspection.add(
        "",
        ("size", f"{nbytes(size)}, records of {kitti.RECORD_BYTES} bytes"),
        ("reflectance", f"{reflectance.min():.2f} … {reflectance.max():.2f}"),
        (
            "frame",
            f"x forward, y left, z up; raised by lidar_height_m = {height_m} m, as the reader does",
        ),
    )
    inspection.warn_if(
        nonfinite_count,
        f"NaN/inf points: {nonfinite_count:,} of {nonfinite_count + len(points):,}; the reader "
        "drops them: fetch the file again",
    )
    is_outside = float(np.nanmin(reflectance)) < 0 or float(np.nanmax(reflectance)) > 255
    inspection.warn_if(
        is_outside, "reflectances outside 0 … 255: is this file NCLT's? Then add --format nclt"
    )
    diagnose(points, mounted_m=height_m).add_to(inspection)


def _describe_packets(path: Path, inspection: Inspection) -> None:
    """Describe velodyne_hits.bin: all packet headers, and the points of one revolution."""
    packets = read_packets(path)
    utimes = packets.utimes
    middle = len(utimes) // 2
    revolution = [
        packet
        for packet in range(middle, len(utimes))
        if utimes[packet] - utimes[middle] < REVOLUTION_US
    ]
    hits = np.concatenate([packets.hits(packet) for packet in revolution])
    lasers = (hits[:, 3] >> 8).astype(np.uint8)
    xyzrph = np.array([nclt.BODY_T_VELODYNE_XYZRPH])
    body_T_velodyne = flip_ned(pose(xyzrph[:, :3], np.radians(xyzrph[:, 3:])))[0]
    points = transformed(body_T_velodyne, nclt.decode(hits.ravel()))
    inspection.kind = "NCLT Velodyne packets"
    inspection.add(
        "",
        ("size", nbytes(path.stat().st_size)),
        ("packets", f"{len(utimes):,}, with {packets.offsets[-1]:,} hits"),
        ("from", moment(int(utimes[0]) * 1000)),
        ("span", duration((utimes[-1] - utimes[0]) * 1e-6)),
        (
            "frame",
            "the sensor's, not motion compensated; the cloud below is in the body frame, by the "
            "extrinsics of NCLT",
        ),
    )
    disordered_count = int((np.diff(utimes) < 0).sum())
    inspection.warn_if(
        disordered_count,
        f"{disordered_count} packets are stamped before the one ahead of them: sort them before "
        "use",
    )
    title = f"cloud, {len(revolution)} packets of one revolution from the middle"
    diagnose(points, lasers).add_to(inspection, title)


def describe_own_scan(path: Path, inspection: Inspection) -> None:
    """Describe a .bin, .npy or .pcd of another robot, decoded as the reader of folders does it.

    Raises LogError where the reader does, and for a file without a finite point.
    """
    data = path.read_bytes()
    points = folder.points(data, path)
    finite_points = points[np.isfinite(points).all(axis=1)]
    if not len(finite_points):
        raise LogError(f"{path}: none of its {len(points)} points has finite x, y and z")
    frame = "taken as x forward, y left, z up, in metres"
    size = nbytes(len(data))
    if path.suffix == ".pcd":
        points = finite_points  # others are beams without a return, in their places
        inspection.kind = "PCD cloud"
        inspection.add("", *_pcd_rows(data, path, len(finite_points)))
    elif path.suffix == ".npy":
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        inspection.kind = "array of points"
        shape = ("shape", f"{array.dtype}{array.shape}")
        inspection.add("", shape, ("size", size), ("frame", frame))
    else:
        width = bin_layout.point_bytes(data) or 0
        name = bin_layout.NAMES_BY_COMMONNESS.get(width)
        layout = f"{width} bytes{f' ({name})' if name else ''}, found from the content"
        reader = f"the dataset folder, with point_bytes: {width} or 0 in conf/dataset/folder.yaml"
        inspection.kind = "points of 32-bit floats"
        inspection.add(
            "", ("size", f"{size}, records of {layout}"), ("read by", reader), ("frame", frame)
        )
    diagnose(points).add_to(inspection)


def _pcd_rows(data: bytes, path: Path, finite_count: int) -> list[tuple[str, str]]:
    """Rows on the header of a .pcd with so many finite points."""
    header = pcd.parse(data, path)
    points_text = f"{finite_count:,}"
    if finite_count < header.points:
        points_text += f", and {header.points - finite_count:,} that are not finite"
    fields = []
    for name, count, dtype in zip(header.fields, header.counts, header.types, strict=True):
        name_text = f"{name}×{count}" if count > 1 else name
        fields.append(f"{name_text} {dtype[1:]}")  # without the byte order
    return [
        ("size", f"{nbytes(len(data))}, DATA {header.data}"),
        ("fields", ", ".join(fields)),
        ("points", points_text),
        (
            "frame",
            "taken as x forward, y left, z up, in metres; conf/dataset/folder.yaml says how it "
            "lies in the vehicle",
        ),
    ]


def moment_of(path: Path) -> str:
    """When a file named UTIME.bin, by its stamp in µs since 1970, was recorded."""
    if path.stem.isdecimal() and len(path.stem) <= MAX_UTIME_DIGITS:
        return moment(int(path.stem) * 1000)
    return "unknown: the name is no utime"
