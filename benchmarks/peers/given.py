"""What all take: the same bytes for peers and for us."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import octree, retrieval, scan_context, sequence
from pipeline.core.frames import moved
from pipeline.matching.ranking import Model
from pipeline.readers.kitti import Kitti
from stages import build

SCANS = 16
ROWS = 5_000
QUERIES = 24
PLACES = 597
SENSOR_M = 1.73  # above the vehicle's origin


def clouds(path: Path) -> tuple[str, int]:
    """Write float32 points (scan, point, 3), ground at z = 0, of KITTI where `YEARLOC_KITTI` names
    its root; what they are."""
    name = "simulated scans"
    scans = scan_context.scans(SCANS)
    if "YEARLOC_KITTI" in os.environ:
        log = Kitti().open(Path(os.environ["YEARLOC_KITTI"]), "00")
        name = "KITTI 00"
        scans = [np.asarray(log.points(row), np.float32) for row in range(SCANS)]
    points = min(map(len, scans))
    np.stack([scan[:points] for scan in scans]).astype("<f4").tofile(path)
    return f"{name}, {points:,} points", len(scans)


def images(path: Path) -> tuple[int, int]:
    """Write float32 Scan Contexts (row, ring, sector) that see all around, as KITTI's do; the
    queries, last, are rows turned and changed."""
    rows = retrieval.scan_contexts(ROWS, blind=0)
    rng = np.random.default_rng(1)
    chosen = rng.choice(ROWS, QUERIES, replace=False)
    turned = np.stack(
        [np.roll(rows[row], rng.integers(0, rows.shape[2]), axis=1) for row in chosen]
    )
    changed = np.where(
        rng.random(turned.shape) < 0.4,
        retrieval.scan_contexts(ROWS + QUERIES, blind=0)[ROWS:],
        turned,
    )
    np.concatenate([rows, changed]).astype("<f4").tofile(path)
    return ROWS, QUERIES


def drive(path: Path, origins: Path) -> tuple[str, int]:
    """Write float32 points (scan, point, 3) of a drive and where its sensor was (scan, 3), in the
    world; what they are."""
    name, scans = octree.drive()
    points = min(len(cloud) for cloud, _ in scans[: octree.SCANS])
    world = [moved(pose, cloud[:points]) for cloud, pose in scans[: octree.SCANS]]
    sensors = [
        pose[:3, 3] + pose[:3, :3] @ (0.0, 0.0, SENSOR_M) for _, pose in scans[: octree.SCANS]
    ]
    np.stack(world).astype("<f4").tofile(path)
    np.stack(sensors).astype("<f4").tofile(origins)
    return f"{name}, {points:,} points", len(world)


def pictures(path: Path) -> int:
    """Write the pixels (drive, image, pixel) of two drives as bytes; how many images each has."""
    np.stack(sequence.drives()).tofile(path)
    return sequence.FEW


def sci() -> tuple[Any, Model]:
    """SCI and its network for PLACES places, as it is before training."""
    import torch

    from pipeline.networks.loop import arrays

    method = build("method", "sci", threads=1)
    torch.manual_seed(0)
    weights = arrays(method.network(PLACES, 40, 120))
    return method, {
        "place_xy_m": np.zeros((PLACES, 2)),
        "image_shape": np.array([40, 120]),
        **weights,
    }
