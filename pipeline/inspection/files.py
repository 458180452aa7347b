"""One raw scan file: an NCLT or KITTI .bin, NCLT's packets, or an array of points."""

import mmap
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, LogError
from pipeline.formats import kitti, nclt
from pipeline.frames import flip_ned, pose, transform
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, Section, duration, moment, nbytes
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.nclt import Z_UP, read_velodyne_sync

FORMATS = {"velodyne_sync": "nclt", "velodyne": "kitti"}
"""A scan's format by the name of its folder."""
REVOLUTION_US = 100_000


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
        return packets(path)
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


def packets(path: Path) -> Inspection:
    """velodyne_hits.bin: every packet's header, and the points of one revolution in the middle, in the body frame."""
    starts, counts, utimes = _packets(path)
    middle = len(starts) // 2
    chosen = [i for i in range(middle, len(starts)) if utimes[i] - utimes[middle] < REVOLUTION_US]
    records = np.concatenate([_hits(path, starts[i], counts[i]) for i in chosen])
    numbers = np.array([nclt.BODY_T_VELODYNE_XYZRPH])
    body_T_velodyne = flip_ned(pose(numbers[:, :3], np.radians(numbers[:, 3:])))[0]
    points = transform(body_T_velodyne, (nclt.decode(records) * Z_UP).astype(np.float32))
    diagnosis = diagnose(points, (records[:, 3] >> 8).astype(np.uint8))
    steps = np.diff(utimes)
    cells = (
        ("size", nbytes(path.stat().st_size)),
        ("packets", f"{len(starts):,}, with {sum(counts):,} hits"),
        ("from", moment(utimes[0] * 1000)),
        ("span", duration((utimes[-1] - utimes[0]) * 1e-6)),
        ("frame", "the sensor's, not motion compensated; below turned into the body's by the data set's extrinsics"),
    )
    found: tuple[str, ...] = ()
    if (steps < 0).any():
        found = (f"{int((steps < 0).sum())} packets are stamped before the one ahead of them: sort them before use",)
    title = f"cloud, {len(chosen)} packets of one revolution from the middle"
    return Inspection(
        f"{path} — NCLT Velodyne packets", (Section("", cells), diagnosis.section(title)), found + diagnosis.warnings
    )


def array_file(path: Path) -> Inspection:
    """A .npy with points (n, 3 or more); what follows xyz is left aside."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise LogError(f"{path}: not a whole .npy file of numbers ({str(error).splitlines()[0]}); save it anew") from None
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu" or not len(array):
        raise LogError(f"{path}: expected points (n, 3 or more) as numbers, found {array.dtype}{array.shape}")
    stride = max(1, len(array) // 2_000_000)
    diagnosis = diagnose(np.asarray(array[::stride, :3], np.float64))
    cells = [("shape", f"{array.dtype}{array.shape}"), ("size", nbytes(path.stat().st_size))]
    cells += [("looked at", f"every {stride}th point")] if stride > 1 else []
    cells += [("frame", "taken as x forward, y left, z up, in metres")]
    return Inspection(f"{path} — array of points", (Section("", tuple(cells)), diagnosis.section()), diagnosis.warnings)


def _packets(path: Path) -> tuple[list[int], list[int], NDArray[np.int64]]:
    """First byte, hits and utime of every packet; raises LogError with the byte of the first broken one."""
    size = path.stat().st_size
    if not size:
        raise LogError(f"{path}: empty; expected Velodyne packets: fetch the file anew")
    magic = struct.pack("<4H", *[nclt.PACKET_MAGIC] * 4)
    starts, counts, utimes, at = [], [], [], 0
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        while at < size:
            whole = at + nclt.PACKET_HEADER_BYTES <= size and data[at : at + 8] == magic
            hits, utime = struct.unpack_from("<IQ", data, at + 8) if whole else (0, 0)
            end = at + nclt.PACKET_HEADER_BYTES + nclt.RECORD_BYTES * hits
            if not whole or end > size:
                raise LogError(f"{path}: no whole packet at byte {at}; the file is damaged or cut short: fetch it anew")
            starts.append(at)
            counts.append(hits)
            utimes.append(utime)
            at = end
    return starts, counts, np.array(utimes, np.int64)


def _hits(path: Path, start: int, count: int) -> NDArray[np.uint16]:
    """Records (count, 4) of the packet that starts at a byte."""
    return np.fromfile(path, "<u2", 4 * count, offset=start + nclt.PACKET_HEADER_BYTES).reshape(-1, 4)


def _utime(path: Path) -> str:
    return moment(int(path.stem) * 1000) if path.stem.isdecimal() and len(path.stem) <= 17 else "unknown: the name is no utime"
