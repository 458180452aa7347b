"""The inputs of all races: the same bytes for peers and for us."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import transformed
from pipeline.matching.patches import differences
from pipeline.matching.ranking import Model
from pipeline.matching.sequence import cheapest, enhance_contrast, runs, search
from pipeline.readers.kitti import Kitti
from stages import build

SCANS = 16
ROWS = 5_000
QUERIES = 24
PLACES = 597
SENSOR_M = 1.73  # above the vehicle's origin
RINGS = 40
SECTORS = 120
MAPPED_SCANS = 6
"""Scans that are inserted in a row, so that the map is not always in a cold cache."""
IMAGES = 400
PIXELS = 2_048
HALF_SEQUENCE = 5
OFFSETS = runs(2 * HALF_SEQUENCE, 0.8, 1.2, 0.1)


def clouds(path: Path) -> tuple[str, int]:
    """Write float32 points (scan, point, 3), with the ground at z = 0; returns what they are.

    They are KITTI's if `YEARLOC_KITTI` names its root, else simulated.
    """
    name, posed_scans = _drive()
    scans = [points_m for points_m, _ in posed_scans]
    points = min(map(len, scans))
    np.stack([scan[:points] for scan in scans]).astype("<f4").tofile(path)
    return f"{name}, {points:,} points", len(scans)


def images(path: Path) -> tuple[int, int]:
    """Write float32 Scan Contexts (row, ring, sector) that see all around, as KITTI's do.

    The last ones are the queries: rows that are turned and changed.
    """
    rows = _scan_contexts(ROWS)
    rng = np.random.default_rng(1)
    chosen = rng.choice(ROWS, QUERIES, replace=False)
    turned = np.stack(
        [np.roll(rows[row], rng.integers(0, rows.shape[2]), axis=1) for row in chosen]
    )
    changed = np.where(
        rng.random(turned.shape) < 0.4,
        _scan_contexts(ROWS + QUERIES)[ROWS:],
        turned,
    )
    np.concatenate([rows, changed]).astype("<f4").tofile(path)
    return ROWS, QUERIES


def drive(path: Path, origins: Path) -> tuple[str, int]:
    """Write float32 points (scan, point, 3) of a drive and its sensor's positions (scan, 3).

    Both are in the world's frame. Returns what they are.
    """
    name, scans = _drive()
    scans = scans[:MAPPED_SCANS]
    points = min(len(cloud) for cloud, _ in scans)
    world = [transformed(pose, cloud[:points].astype(np.float64)) for cloud, pose in scans]
    sensors = [pose[:3, 3] + pose[:3, :3] @ (0.0, 0.0, SENSOR_M) for _, pose in scans]
    np.stack(world).astype("<f4").tofile(path)
    np.stack(sensors).astype("<f4").tofile(origins)
    return f"{name}, {points:,} points", len(world)


def pictures(path: Path) -> int:
    """Write the pixels (drive, image, pixel) of two drives as bytes; returns the images of each.

    They are random, and nearly a third of the pixels are the same in both drives.
    """
    rng = np.random.default_rng(0)
    references, others = rng.integers(0, 256, (2, IMAGES, PIXELS), dtype=np.uint8)
    queries = np.where(rng.random((IMAGES, PIXELS)) < 0.3, references, others)
    np.stack([references, queries]).tofile(path)
    return IMAGES


def matched(references: NDArray[np.uint8], queries: NDArray[np.uint8]) -> NDArray[np.int64]:
    """SeqSLAM: the matched reference of each query (image, pixel) with a whole sequence around."""
    enhanced = enhance_contrast(differences(references, queries), 2 * HALF_SEQUENCE)
    enhanced -= enhanced.min()
    costs = np.ascontiguousarray(search(enhanced, OFFSETS).T)
    return cheapest(costs, 1)[:, 0]


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


def _drive() -> tuple[str, list[tuple[NDArray[np.float32], NDArray[np.float64]]]]:
    """The drive's name, and SCANS scans (point, 3) about 0.9 m apart with their poses (4, 4)."""
    if "YEARLOC_KITTI" in os.environ:
        log = Kitti().open(Path(os.environ["YEARLOC_KITTI"]), "00")
        scans = [np.asarray(log.points(row), np.float32) for row in range(SCANS)]
        return "KITTI 00", list(zip(scans, log.world_T_scan[:SCANS], strict=True))
    poses = np.tile(np.eye(4), (SCANS, 1, 1))
    poses[:, 0, 3] = 0.9 * np.arange(SCANS) + 0.01
    poses[:, 1, 3] = 0.02
    return "simulated scans", list(zip(_scans(SCANS), poses, strict=True))


def _scans(number: int, points: int = 120_000) -> list[NDArray[np.float32]]:
    """Scans of a 64-beam scanner in firing order, more than a core's own cache holds."""
    rng = np.random.default_rng(0)
    azimuth = np.repeat(np.linspace(0, 2 * np.pi, points // 64, endpoint=False), 64)
    elevation = np.tile(np.deg2rad(np.linspace(-24.8, 2.0, 64)), points // 64)
    sine = np.sin(elevation)
    ground_m = np.where(elevation < 0, SENSOR_M / np.maximum(-sine, 1e-6), np.inf)
    clouds = []
    for _ in range(number):
        waves = np.abs(np.sin(azimuth * rng.integers(1, 4) + rng.uniform(0, 6)))
        wall_m = 8 + 30 * waves + rng.normal(0, 0.05, len(azimuth))
        range_m = np.minimum(wall_m, ground_m)
        turned = azimuth + rng.uniform(0, 2 * np.pi)
        cosine = np.cos(elevation)
        directions = np.stack([np.cos(turned) * cosine, np.sin(turned) * cosine, sine], axis=1)
        clouds.append((directions * range_m[:, None] + (0, 0, SENSOR_M)).astype(np.float32))
    return clouds


def _scan_contexts(number: int) -> NDArray[np.float32]:
    """Heights (number, ring, sector) as sparse as a 3-D scanner's: far rings see little."""
    rng = np.random.default_rng(0)
    share_seen = np.linspace(0.3, 0.02, RINGS)[:, None]
    seen = rng.random((number, RINGS, SECTORS)) < share_seen
    return np.where(seen, rng.gamma(2.0, 2.0, seen.shape), 0).astype(np.float32)
