"""NCLT's velodyne_hits.bin: packets as the sensor sent them, gigabytes a drive, so only looked through."""

import mmap
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import nclt
from pipeline.frames import flip_ned, pose, transform
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, Section, duration, moment, nbytes

REVOLUTION_US = 100_000


def packets(path: Path) -> Inspection:
    """velodyne_hits.bin: every packet's header, and the points of one revolution in the middle, in the body frame."""
    starts, counts, utimes = _packets(path)
    middle = len(starts) // 2
    chosen = [i for i in range(middle, len(starts)) if utimes[i] - utimes[middle] < REVOLUTION_US]
    records = np.concatenate([_hits(path, starts[i], counts[i]) for i in chosen])
    numbers = np.array([nclt.BODY_T_VELODYNE_XYZRPH])
    body_T_velodyne = flip_ned(pose(numbers[:, :3], np.radians(numbers[:, 3:])))[0]
    points = transform(body_T_velodyne, nclt.decode(records.ravel()).astype(np.float32))
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
