"""Describes one raw scan file.

It is an NCLT or KITTI .bin, the packets of velodyne_hits.bin, a PCD, or an array of points.
"""

from pathlib import Path

import numpy as np

from pipeline.core.errors import LogError
from pipeline.core.frames import flip_ned, pose, transform
from pipeline.formats import bin_layout, kitti, nclt, pcd
from pipeline.formats.folder import LARGEST_BYTES, refuse_array
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, duration, moment, nbytes
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.nclt import read_packets, read_velodyne_sync

FORMATS = {"velodyne_sync": "nclt", "velodyne": "kitti"}
"""The format of a scan by the name of its folder."""
REVOLUTION_US = 100_000
MOST_POINTS = 2_000_000
"""Of a larger array, only every n-th point is inspected."""


def format_of(path: Path, as_format: str | None) -> str:
    """The format of a .bin or a folder of them: nclt, kitti or folder.

    It is `as_format` if given, else told by the folder's name, else by the bytes.
    """
    if format_name := as_format or FORMATS.get(path.name if path.is_dir() else path.parent.name):
        return format_name
    example = next(iter(sorted(path.glob("*.bin"))), path) if path.is_dir() else path
    return (
        "nclt"
        if example.is_file()
        and bin_layout.point_bytes(example.read_bytes()) == bin_layout.NCLT_BYTES
        else "folder"
    )


def scan_file(path: Path, as_format: str | None, inspection: Inspection) -> None:
    """Describe a .bin with one scan, or velodyne_hits.bin; raises LogError for a damaged one."""
    if path.name == "velodyne_hits.bin":
        _packets(path, inspection)
        return
    inspect = {"nclt": _nclt_scan, "kitti": _kitti_scan, "folder": _own_scan}[
        format_of(path, as_format)
    ]
    if not path.stat().st_size:
        raise LogError(f"{path}: empty; expected records of one scan: fetch the file anew")
    inspect(path, inspection)


def _nclt_scan(path: Path, inspection: Inspection) -> None:
    """Describe velodyne_sync/UTIME.bin: in the body frame, ground near z = 0."""
    points = read_velodyne_sync(path)
    tail = np.fromfile(path, "<u2").reshape(-1, 4)[:, 3]
    intensity = tail & 0xFF
    lasers = (tail >> 8).astype(np.uint8)
    inspection.describe(
        "NCLT scan, motion compensated",
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
    inspection.warn(lasers.max() > 31, wrong_format)
    diagnose(points, lasers).add_to(inspection)


def _kitti_scan(path: Path, inspection: Inspection) -> None:
    """Describe velodyne/NNNNNN.bin, raised to the ground by the reader's default height."""
    height_m = Kitti().lidar_height_m
    size = path.stat().st_size
    points = read_velodyne(path, height_m)
    nonfinite = size // kitti.RECORD_BYTES - len(points)
    reflectance = np.fromfile(path, "<f4").reshape(-1, 4)[:, 3]
    inspection.describe(
        "KITTI scan",
        ("size", f"{nbytes(size)}, records of {kitti.RECORD_BYTES} bytes"),
        ("reflectance", f"{reflectance.min():.2f} … {reflectance.max():.2f}"),
        (
            "frame",
            f"x forward, y left, z up; raised by lidar_height_m = {height_m} m, as the reader does",
        ),
    )
    inspection.warn(
        nonfinite,
        f"NaN/inf points: {nonfinite:,} of {nonfinite + len(points):,}; the reader drops them: "
        "fetch the file anew",
    )
    outside = float(np.nanmin(reflectance)) < 0 or float(np.nanmax(reflectance)) > 255
    inspection.warn(
        outside, "reflectances outside 0 … 255: is this file NCLT's? Then add --format nclt"
    )
    diagnose(points, mounted_m=height_m).add_to(inspection)


def _own_scan(path: Path, inspection: Inspection) -> None:
    """Describe the .bin of another robot: records that begin with x, y, z as 32-bit floats."""
    data = path.read_bytes()
    points = bin_layout.points(data, path).astype(np.float64)
    width = bin_layout.point_bytes(data) or 0
    layout_name = (
        f" ({bin_layout.NAMES_BY_COMMONNESS[width]})"
        if width in bin_layout.NAMES_BY_COMMONNESS
        else ""
    )
    inspection.describe(
        "points of 32-bit floats",
        (
            "size",
            f"{nbytes(len(data))}, records of {width} bytes{layout_name}, found from the content",
        ),
        (
            "read by",
            f"the dataset folder, with point_bytes: {width} or 0 in conf/dataset/folder.yaml",
        ),
        ("frame", "taken as x forward, y left, z up, in metres"),
    )
    diagnose(points).add_to(inspection)


def _packets(path: Path, inspection: Inspection) -> None:
    """Describe velodyne_hits.bin: all packet headers, and the points of one revolution.

    The revolution is from the middle of the file; its points are in the body frame.
    """
    packets = read_packets(path)
    middle = len(packets.utimes) // 2
    utimes = packets.utimes
    revolution = [
        packet
        for packet in range(middle, len(utimes))
        if utimes[packet] - utimes[middle] < REVOLUTION_US
    ]
    records = np.concatenate([packets.hits(packet) for packet in revolution])
    numbers = np.array([nclt.BODY_T_VELODYNE_XYZRPH])
    body_T_velodyne = flip_ned(pose(numbers[:, :3], np.radians(numbers[:, 3:])))[0]
    points = transform(body_T_velodyne, nclt.decode(records.ravel()).astype(np.float32))
    inspection.describe(
        "NCLT Velodyne packets",
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
    disordered = int((np.diff(utimes) < 0).sum())
    inspection.warn(
        disordered,
        f"{disordered} packets are stamped before the one ahead of them: sort them before use",
    )
    diagnosis = diagnose(points, (records[:, 3] >> 8).astype(np.uint8))
    diagnosis.add_to(
        inspection, f"cloud, {len(revolution)} packets of one revolution from the middle"
    )


def pcd_file(path: Path, inspection: Inspection) -> None:
    """Describe a .pcd: its header and its points.

    Raises LogError for a damaged one, or one without a finite point.
    """
    data = path.read_bytes()
    header = pcd.parse(data, path)
    points = pcd.decode(data, path, LARGEST_BYTES)
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        raise LogError(f"{path}: none of its {len(points)} points has finite x, y and z")
    fields = zip(header.fields, header.counts, header.types, strict=True)
    lost_points = (
        f", and {len(points) - len(finite):,} that are not finite"
        if len(finite) < len(points)
        else ""
    )
    inspection.describe(
        "PCD cloud",
        ("size", f"{nbytes(len(data))}, DATA {header.data}"),
        (
            "fields",
            ", ".join(
                f"{name}{f'×{count}' if count > 1 else ''} {kind[1:]}"
                for name, count, kind in fields
            ),
        ),
        ("points", f"{len(finite):,}{lost_points}"),
        (
            "frame",
            "taken as x forward, y left, z up, in metres; conf/dataset/folder.yaml says how it "
            "lies in the vehicle",
        ),
    )
    diagnose(finite).add_to(inspection)


def array_file(path: Path, inspection: Inspection) -> None:
    """Describe a .npy with points (n, 3 or more), of which only x, y, z are inspected.

    Raises LogError for any other array.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise LogError(
            f"{path}: no whole .npy file ({type(error).__name__}); save it anew"
        ) from None
    refuse_array(path, array.dtype, array.shape)
    if not array.size:
        raise LogError(f"{path}: an array without points, {array.dtype}{array.shape}")
    shape = array.shape
    array = array.reshape(-1, shape[-1])
    stride = max(1, len(array) // MOST_POINTS)
    inspection.describe(
        "array of points",
        ("shape", f"{array.dtype}{shape}"),
        ("size", nbytes(path.stat().st_size)),
        *([("inspected", f"every {stride}th point")] if stride > 1 else []),
        ("frame", "taken as x forward, y left, z up, in metres"),
    )
    diagnose(np.asarray(array[::stride, :3], np.float64)).add_to(inspection)


def moment_of(path: Path) -> str:
    """When a file named UTIME.bin was recorded."""
    return (
        moment(int(path.stem) * 1000)
        if path.stem.isdecimal() and len(path.stem) <= 17
        else "unknown: the name is no utime"
    )
