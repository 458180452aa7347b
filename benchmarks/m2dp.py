"""M2DP of 120,000-point scans, 64 planes of 8 × 16 bins: ours against numpy and a copy of the
points."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.race import Race, race
from benchmarks.scan_context import scans
from pipeline.views.m2dp import M2dp


def numpy_m2dp(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """The definition (METHODS 3.1) in float64 numpy, as a port of the authors' Matlab would have
    it."""
    centred = points.astype(np.float64)
    centred -= centred.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    turned = centred @ (axes * np.sign(axes[np.abs(axes).argmax(axis=0), range(3)]))
    radii = np.linspace(0, np.sqrt(np.linalg.norm(turned, axis=1).max()), 9) ** 2
    radii[-1] += 0.001
    angles = np.linspace(-np.pi, np.pi, 17)
    shares = np.empty((64, 128))
    for p, (azimuth, elevation) in enumerate(np.ndindex(4, 16)):
        az = -np.pi / 2 + azimuth * np.pi / 3
        el = elevation * np.pi / 30
        normal = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        x = np.eye(3)[0] - normal[0] * normal
        u = turned @ x
        v = turned @ np.cross(normal, x)
        sector = np.minimum(np.searchsorted(angles, np.arctan2(v, u), "right") - 1, 15)
        ring = np.minimum(np.searchsorted(radii, np.sqrt(u * u + v * v), "right") - 1, 7)
        shares[p] = np.bincount(ring * 16 + sector, minlength=128) / len(points)
    left, _, right = np.linalg.svd(shares, full_matrices=False)
    signature: NDArray[np.float64] = np.abs(np.concatenate([left[:, 0], right[0]]))
    return signature


def run() -> list[Race]:
    """From points to the signature."""
    clouds = scans()
    ours = M2dp()
    if any(np.abs(ours(cloud) - numpy_m2dp(cloud)).max() > 1e-6 for cloud in clouds[:4]):
        raise AssertionError("a signature differs from the float64 definition by more than 1e-6")
    copy = np.empty_like(clouds[0])
    found = race(
        "M2DP of 120,000 points, 64 planes (signatures equal the float64 definition to 1e-6)",
        {
            "yearloc": lambda i: ours(clouds[i % 16]),
            "numpy arctan2 + searchsorted + bincount": lambda i: numpy_m2dp(clouds[i % 16]),
            "memcpy of the points": lambda i: np.copyto(copy, clouds[i % 16]),
        },
        rounds=12,
    )
    return [found]


if __name__ == "__main__":
    for result in run():
        print(result.table())
