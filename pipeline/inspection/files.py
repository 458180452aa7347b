"""One raw scan file: an NCLT or KITTI .bin, or an array of points."""

from pathlib import Path

import numpy as np

from pipeline.errors import ConfigError, LogError
from pipeline.formats import kitti, nclt
from pipeline.inspection import packets
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, Section, moment, nbytes
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.nclt import read_velodyne_sync

FORMATS = {"velodyne_sync": "nclt", "velodyne": "kitti"}
"""A scan's format by the name of its folder."""


def format_of(folder: Path, as_format: str | None) -> str:
    """nclt or kitti: by the folder's name, else as told; raises ConfigError if neither says."""
    if as_format not in (None, "nclt", "kitti"):
        raise ConfigError(f"--format {as_format}: the formats are nclt and kitti")
    told = as_format or FORMATS.get(folder.name)
    if told is None:
        raise ConfigError(
            f"{folder}: a .bin may be NCLT's or KITTI's, and the folder's name (velodyne_sync, velodyne) does not say; "
            "add --format nclt|kitti"
        )
    return told


def scan_file(path: Path, as_format: str | None) -> Inspection:
    """A .bin with one scan."""
    if path.name == "velodyne_hits.bin":
        return packets.packets(path)
    told = as_format if as_format else FORMATS.get(path.parent.name)
    if told is None:
        raise ConfigError(
            f"{path}: may be NCLT's or KITTI's, and its folder is named neither velodyne_sync nor velodyne; "
            "add --format nclt|kitti"
        )
    if not path.stat().st_size:
        raise LogError(f"{path}: empty; expected records of one scan: fetch the file anew")
    return nclt_scan(path) if format_of(path.parent, told) == "nclt" else kitti_scan(path)


def nclt_scan(path: Path) -> Inspection:
    """velodyne_sync/UTIME.bin: the body frame, ground near z = 0."""
    points = read_velodyne_sync(path)
    tail = np.fromfile(path, "<u2").reshape(-1, 4)[:, 3]
    lasers = (tail >> 8).astype(np.uint8)
    diagnosis = diagnose(points, lasers)
    cells = [
        ("size", f"{nbytes(path.stat().st_size)}, records of {nclt.RECORD_BYTES} bytes"),
        ("taken", _utime(path)),
        ("intensity", f"{int((tail & 0xFF).min())} … {int((tail & 0xFF).max())}"),
        ("lasers", f"ids {int(lasers.min())} … {int(lasers.max())}"),
        ("frame", "body: x forward, y left, z up (the file's y right, z down, turned by the reader)"),
    ]
    found: tuple[str, ...] = ()
    if int(lasers.max()) > 31:
        found = (f"laser id {int(lasers.max())}: an HDL-32E has ids 0–31; is this file KITTI's? Then add --format kitti",)
    return Inspection(
        f"{path} — NCLT scan, motion compensated", (Section("", tuple(cells)), diagnosis.section()), found + diagnosis.warnings
    )


def kitti_scan(path: Path) -> Inspection:
    """velodyne/NNNNNN.bin, raised to the ground by the reader's default height."""
    points = read_velodyne(path)
    height_m = Kitti().lidar_height_m
    size = path.stat().st_size
    lost = size // kitti.RECORD_BYTES - len(points)
    diagnosis = diagnose(points + np.array([0.0, 0.0, height_m]))
    reflectance = np.fromfile(path, "<f4").reshape(-1, 4)[:, 3]
    cells = [
        ("size", f"{nbytes(size)}, records of {kitti.RECORD_BYTES} bytes"),
        ("reflectance", f"{reflectance.min():.2f} … {reflectance.max():.2f}"),
        ("frame", f"x forward, y left, z up; raised by lidar_height_m = {height_m} m, as the reader does"),
    ]
    found: tuple[str, ...] = ()
    if lost:
        found = (f"NaN/inf points: {lost:,} of {lost + len(points):,}; the reader drops them: fetch the file anew",)
    if float(np.nanmin(reflectance)) < 0 or float(np.nanmax(reflectance)) > 255:
        found += ("reflectances outside 0 … 255: is this file NCLT's? Then add --format nclt",)
    return Inspection(f"{path} — KITTI scan", (Section("", tuple(cells)), diagnosis.section()), found + diagnosis.warnings)


def array_file(path: Path) -> Inspection:
    """A .npy with points (n, 3 or more); what follows xyz is left aside."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise LogError(f"{path}: not a whole .npy file of numbers ({type(error).__name__}); save it anew") from None
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu" or not len(array):
        raise LogError(f"{path}: expected points (n, 3 or more) as numbers, found {array.dtype}{array.shape}")
    stride = max(1, len(array) // 2_000_000)
    diagnosis = diagnose(np.asarray(array[::stride, :3], np.float64))
    cells = [("shape", f"{array.dtype}{array.shape}"), ("size", nbytes(path.stat().st_size))]
    cells += [("looked at", f"every {stride}th point")] if stride > 1 else []
    cells += [("frame", "taken as x forward, y left, z up, in metres")]
    return Inspection(f"{path} — array of points", (Section("", tuple(cells)), diagnosis.section()), diagnosis.warnings)


def _utime(path: Path) -> str:
    return moment(int(path.stem) * 1000) if path.stem.isdecimal() and len(path.stem) <= 17 else "unknown: the name is no utime"
