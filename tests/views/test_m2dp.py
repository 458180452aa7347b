"""M2DP, against the authors' numbers (METHODS 3.1) and the definition in float64; and clouds
without a shape.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.readers.kitti import read_velodyne
from pipeline.readers.nclt import read_velodyne_sync
from pipeline.views.m2dp import M2dp

K = np.arange(300)
AUTHORS = np.stack([(7 * K) % 61 / 4 - 5, (K**2 % 47) / 5, (K**3 % 29) / 10 + 0.01 * K], axis=1)
"""The cloud for which METHODS 3.1 gives the authors' numbers."""


def definition(points: np.ndarray, view: M2dp) -> np.ndarray:
    """Counts (plane, bin) of points (n, 3) by METHODS 3.1, steps 1 to 3, in float64."""
    centred = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axes = axes[:, ::-1]
    for axis in axes.T:
        axis *= np.sign(axis[np.abs(axis).argmax()])
    turned = centred @ axes
    radii = np.linspace(0, np.sqrt(np.linalg.norm(turned, axis=1).max()), view.circles + 1) ** 2
    radii[-1] += 0.001
    angles = np.linspace(-np.pi, np.pi, view.sectors + 1)
    counts = []
    for az in np.linspace(-np.pi / 2, np.pi / 2, view.azimuths):
        for el in np.linspace(0, np.pi / 2, view.elevations):
            normal = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
            x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
            u = turned @ x
            v = turned @ np.cross(normal, x)
            sector = np.minimum(
                np.searchsorted(angles, np.arctan2(v, u), "right") - 1, view.sectors - 1
            )
            ring = np.minimum(np.searchsorted(radii, np.hypot(u, v), "right") - 1, view.circles - 1)
            counts.append(
                np.bincount(ring * view.sectors + sector, minlength=view.circles * view.sectors)
            )
    return np.array(counts)


def cloud(seed: int, n: int, dtype: type = np.float64) -> np.ndarray:
    """Random points (n, 3), with a different spread along each axis, somewhere in the world.

    A tenth of them is ten times further out.
    """
    rng = np.random.default_rng(seed)
    far = np.where(rng.random((n, 1)) < 0.1, 10.0, 1.0)
    return (rng.normal(0, (9, 5, 2), (n, 3)) * far + rng.uniform(-50, 50, 3)).astype(dtype)


def test_the_authors_numbers() -> None:
    planes, bins = np.split(M2dp()(AUTHORS), [64])
    np.testing.assert_allclose(
        planes[:8],
        [0.147039, 0.147807, 0.147262, 0.149802, 0.147728, 0.147816, 0.145904, 0.143118],
        atol=6e-7,
    )
    first = [0.000523, 0.000479, 0, 0.001847, 0.001088, 0.000639, 0.000636, 0.000641]
    second = [0.000433, 0.000215, 0.001078, 0.000655, 0.000488, 0.000210, 0.001394, 0]
    np.testing.assert_allclose(bins[:16], first + second, atol=6e-7)
    assert planes.sum(dtype=np.float64) == pytest.approx(7.831737, abs=2e-6)
    assert bins.sum(dtype=np.float64) == pytest.approx(7.655779, abs=2e-6)


def test_the_signature_is_the_first_singular_pair() -> None:
    view = M2dp()
    points = cloud(0, 5_000)
    u, _, vt = np.linalg.svd(view.counts(points) / 5_000)
    expected = np.concatenate([np.abs(u[:, 0]), np.abs(vt[0])])
    signature = view(points)
    assert signature.dtype == np.float32
    np.testing.assert_allclose(signature, expected, atol=1e-7)
    np.testing.assert_allclose(
        [np.linalg.norm(signature[:64]), np.linalg.norm(signature[64:])], 1, atol=1e-6
    )
    assert (signature >= 0).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [5, 255, 256, 259, 20_000])
def test_every_bin_holds_what_the_definition_says(n: int, dtype: type) -> None:
    points = cloud(n, n, dtype)
    np.testing.assert_array_equal(M2dp().counts(points), definition(points, M2dp()))


def test_points_beside_every_border_are_in_the_bin_that_the_definition_says() -> None:
    # Mirrored at every plane, a cloud's principal axes are x, y, z; so on the plane of elevation
    # 90°, (x, y), borders lie where they are put here, and points 1e-7 of the range beside them:
    # nearer than float32 can tell. All are a tenth of it up.
    shape = np.random.default_rng(1).normal(0, (9, 5, 2), (500, 3))
    reach = 1.05 * np.linalg.norm(shape, axis=1).max()
    angle = np.repeat(np.arange(16) * np.pi / 8, 7)
    share = np.tile((np.arange(1, 8) / 8) ** 2, 16)
    offsets = ((1e-7, 1e-3), (-1e-7, 1e-3), (0.01, 1e-7), (0.01, -1e-7))
    polar = [(share + off, angle + turn) for off, turn in offsets] + [
        (np.full(1, 0.99**0.5), np.full(1, 0.1))
    ]
    beside = [
        reach * np.stack([r * np.cos(a), r * np.sin(a), 0 * a + 0.1], axis=1) for r, a in polar
    ]
    octant = np.concatenate([shape, *beside])
    points = np.concatenate([octant * signs for signs in product((1, -1), repeat=3)])
    np.testing.assert_array_equal(M2dp().counts(points), definition(points, M2dp()))


@pytest.mark.parametrize(
    "view",
    [M2dp(sectors=12), M2dp(circles=5), M2dp(azimuths=3, elevations=5, circles=20, sectors=7)],
)
def test_other_numbers_of_planes_and_bins_are_counted_too(view: M2dp) -> None:
    points = cloud(2, 2_000)
    np.testing.assert_array_equal(view.counts(points), definition(points, view))
    assert view(points).shape == (view.azimuths * view.elevations + view.circles * view.sectors,)


def test_a_real_scan_has_the_definitions_counts(real: Path) -> None:
    for path in ("kitti/sequences/00/velodyne/000000.bin", "kitti/pairs/08/000720.bin"):
        points = read_velodyne(real / path)
        np.testing.assert_array_equal(M2dp().counts(points), definition(points, M2dp()))
    points = read_velodyne_sync(real / "nclt/2012-01-15/velodyne_sync/1326652795280148.bin")
    np.testing.assert_array_equal(M2dp().counts(points), definition(points, M2dp()))


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.ones((1, 3)),
        cloud(4, 2),
        np.full((50, 3), 0.1),
        np.full((50, 3), 1e4 / 3, np.float32),
    ],
    ids=["none", "one", "two", "one spot", "one far spot"],
)
def test_what_has_no_shape_has_a_signature_of_zeros(points: np.ndarray) -> None:
    signature = M2dp()(points)
    assert signature.shape == (192,)
    assert not signature.any()


def test_a_flat_cloud_and_a_line_have_a_signature_of_numbers() -> None:
    for points in (cloud(5, 500) * (1, 1, 0), cloud(5, 500) * (1, 0, 0)):
        signature = M2dp()(points)
        assert np.isfinite(signature).all()
        np.testing.assert_allclose(
            [np.linalg.norm(signature[:64]), np.linalg.norm(signature[64:])], 1, atol=1e-6
        )


def test_points_that_are_not_numbers_are_refused() -> None:
    for value in (np.nan, np.inf, -np.inf):
        points = cloud(6, 10)
        points[4, 1] = value
        with pytest.raises(InputError, match="NaN or infinite"):
            M2dp()(points)
    with pytest.raises(InputError, match=r"shape \(3, 2\)"):
        M2dp()(np.zeros((3, 2)))


def test_threads_draw_what_one_thread_draws() -> None:
    clouds = [cloud(seed, 3_000) for seed in range(8)]
    with ThreadPoolExecutor(8) as pool:
        assert [one.tobytes() for one in pool.map(M2dp(), clouds)] == [
            M2dp()(points).tobytes() for points in clouds
        ]
