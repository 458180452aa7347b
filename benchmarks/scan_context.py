"""Scan Context binning of a 120,000-point scan, 40 × 120 bins: ours against numpy, torch and a copy
of the points."""

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.race import Race, race
from pipeline.views.scan_context import ScanContext

RINGS = 40
SECTORS = 120
RANGE_M = 80.0


def scans(number: int = 16, points: int = 120_000) -> list[NDArray[np.float32]]:
    """Scans of a 64-beam scanner in firing order, so many that they do not stay in a core's own
    cache."""
    rng = np.random.default_rng(0)
    azimuth = np.repeat(np.linspace(0, 2 * np.pi, points // 64, endpoint=False), 64)
    elevation = np.tile(np.deg2rad(np.linspace(-24.8, 2.0, 64)), points // 64)
    clouds = []
    for _ in range(number):
        wall_m = (
            8
            + 30 * np.abs(np.sin(azimuth * rng.integers(1, 4) + rng.uniform(0, 6)))
            + rng.normal(0, 0.05, len(azimuth))
        )
        ground_m = np.where(elevation < 0, 1.73 / np.maximum(-np.sin(elevation), 1e-6), np.inf)
        range_m = np.minimum(wall_m, ground_m)
        turned = azimuth + rng.uniform(0, 2 * np.pi)
        xyz = np.stack(
            [
                np.cos(turned) * np.cos(elevation),
                np.sin(turned) * np.cos(elevation),
                np.sin(elevation),
            ],
            axis=1,
        )
        clouds.append((xyz * range_m[:, None] + (0, 0, 1.73)).astype(np.float32))
    return clouds


def reference(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The definition (METHODS 1.1) in float64 numpy: what exact means."""
    x = points[:, 0].astype(np.float64)
    y = points[:, 1].astype(np.float64)
    return _highest(_bins(np.hypot(x, y), np.degrees(np.arctan2(y, x)) % 360), points[:, 2])


def numpy_maximum_at(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The best plain numpy form, in float32 throughout."""
    x, y, z = points.T
    bins = _bins(
        np.sqrt(x * x + y * y), np.arctan2(y, x) * np.float32(180 / np.pi) % np.float32(360)
    )
    return _highest(bins, z)


def torch_scatter_reduce(points: torch.Tensor) -> torch.Tensor:
    """The same with torch."""
    x, y, z = points.unbind(1)
    ring = (torch.sqrt(x * x + y * y) * (RINGS / RANGE_M)).to(torch.int64).clamp(max=RINGS - 1)
    sector = (
        torch.ceil(torch.rad2deg(torch.atan2(y, x)) % 360 * (SECTORS / 360))
        .to(torch.int64)
        .clamp(1, SECTORS)
        - 1
    )
    table = torch.full((RINGS * SECTORS,), -1e30).scatter_reduce_(
        0, ring * SECTORS + sector, z, "amax"
    )
    return torch.where(table > -1e29, table, 0.0)


def _bins(range_m: NDArray[np.floating], azimuth_deg: NDArray[np.floating]) -> NDArray[np.int32]:
    ring = np.minimum((range_m * (RINGS / RANGE_M)).astype(np.int32), RINGS - 1)
    sector = np.clip(np.ceil(azimuth_deg * (SECTORS / 360)).astype(np.int32), 1, SECTORS) - 1
    bins: NDArray[np.int32] = ring * SECTORS + sector
    return bins


def _highest(bins: NDArray[np.int32], z: NDArray[np.float32]) -> NDArray[np.float32]:
    table = np.full(RINGS * SECTORS, -1e30, np.float32)
    np.maximum.at(table, bins, z)
    return np.where(table > -1e29, table, 0).reshape(RINGS, SECTORS)


def run() -> list[Race]:
    """The bare binning, and the authors' whole recipe with the 0.5 m voxel filter and the 5-point
    rule."""
    torch.set_num_threads(1)
    clouds = scans()
    tensors = [torch.from_numpy(cloud) for cloud in clouds]
    ours = ScanContext(voxel_m=0.0, min_points=1)
    authors = ScanContext()
    wrong = sum(int((ours(cloud) != reference(cloud)).sum()) for cloud in clouds)
    if wrong:
        raise AssertionError(f"{wrong} bins differ from the float64 definition")
    copy = np.empty_like(clouds[0])
    bare = race(
        f"Scan Context of 120,000 points, no voxel filter (all {len(clouds)} scans equal the "
        "float64 definition bin by bin)",
        {
            "yearloc": lambda i: ours(clouds[i % 16]),
            "numpy maximum.at": lambda i: numpy_maximum_at(clouds[i % 16]),
            "torch scatter_reduce amax": lambda i: torch_scatter_reduce(tensors[i % 16]),
            "memcpy of the points": lambda i: np.copyto(copy, clouds[i % 16]),
        },
    )
    whole = race(
        "the same with the 0.5 m voxel filter and the 5-point rule",
        {
            "yearloc": lambda i: authors(clouds[i % 16]),
            "numpy unique + add.at + maximum.at": lambda i: voxels_numpy(clouds[i % 16]),
            "memcpy of the points": lambda i: np.copyto(copy, clouds[i % 16]),
        },
        rounds=20,
    )
    return [bare, whole]


def voxels_numpy(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The authors' recipe in plain numpy."""
    p = points.astype(np.float64)
    index = np.floor((p - p.min(axis=0)) / 0.5).astype(np.int64)
    key = (index[:, 0] << 42) | (index[:, 1] << 21) | index[:, 2]
    _, voxel = np.unique(key, return_inverse=True)
    counts = np.bincount(voxel)
    means = np.stack([np.bincount(voxel, p[:, axis]) / counts for axis in range(3)], axis=1)
    bins = _bins(
        np.hypot(means[:, 0], means[:, 1]), np.degrees(np.arctan2(means[:, 1], means[:, 0])) % 360
    )
    heights = _highest(bins, means[:, 2].astype(np.float32))
    return np.where(
        np.bincount(bins, minlength=RINGS * SECTORS).reshape(RINGS, SECTORS) >= 5, heights, 0
    )
