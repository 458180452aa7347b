"""Scan Context, against the authors' check values (METHODS 1.5) and the definition in float64."""

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.readers.nclt import read_velodyne_sync
from pipeline.views.scan_context import ScanContext, quantize

RAW = {"voxel_m": 0.0, "min_points": 1}


def definition(points: np.ndarray, view: ScanContext) -> np.ndarray:
    """The Scan Context of points (n, 3) by METHODS 1.1, steps 2 to 5, point by point in float64."""
    heights: dict[tuple[int, int], list[float]] = {}
    for x, y, z in points.astype(np.float64).tolist():
        r = math.sqrt(x * x + y * y)
        theta = math.degrees(math.atan2(y, x))
        ring = math.floor(r / (view.max_range_m / view.rings))
        if r == 0 or (ring >= view.rings and view.beyond == "drop"):
            continue
        sector = max(math.ceil((theta + 360 if theta < 0 else theta) / (360 / view.sectors)), 1)
        heights.setdefault((min(ring, view.rings - 1), min(sector, view.sectors) - 1), []).append(z)
    image = np.zeros(view.shape, np.float32)
    for cell, values in heights.items():
        if len(values) >= view.min_points:
            image[cell] = max(values)
    return image


def cloud(seed: int, dtype: type, max_range_m: float = 80.0) -> np.ndarray:
    """Random points (n, 3), many of which lie on the borders of rings and sectors.

    Some are exactly on a border, others one rounding beside it.
    """
    rng = np.random.default_rng(seed)
    n = 400
    anywhere = rng.uniform(-1.3 * max_range_m, 1.3 * max_range_m, (n, 2))
    whole = (
        rng.integers(-40, 41, (n, 1))
        * np.array([[3.0, 4.0], [4.0, -3.0], [1.0, 0.0], [0.0, 2.0], [1.0, 1.0]])[
            rng.integers(0, 5, n)
        ]
    )
    angle = np.deg2rad(3.0 * rng.integers(0, 120, n))
    spokes = rng.uniform(0, max_range_m, (n, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
    turn = rng.uniform(0, 2 * np.pi, n)
    circles = (max_range_m / 40 * rng.integers(0, 41, (n, 1))) * np.column_stack(
        [np.cos(turn), np.sin(turn)]
    )
    xy = np.concatenate([anywhere, whole, spokes, circles, np.zeros((1, 2))]).astype(dtype)
    xy = np.concatenate([xy, np.nextafter(xy, dtype(np.inf)), np.nextafter(xy, dtype(-np.inf))])
    return rng.permutation(np.column_stack([xy, rng.uniform(-5, 20, len(xy))]).astype(dtype))


# METHODS 1.5 A, 0-based: x, y, heights of the points, then ring, sector and value.
AUTHORS = [
    (7.0, 0.1, range(5), (3, 0, 4)),
    (0.0, 10.0, range(-3, 2), (5, 29, 1)),
    (-20.0, 0.0, range(2, 8), (10, 59, 7)),
    (0.0, -30.0, range(4), None),  # four points are too few
    (100.0, -100.0, range(10, 15), (39, 104, 14)),
    (-40.0, -40.0, range(-9, -4), (28, 74, -5)),
    (5.0, 0.0, range(20, 25), (2, 0, 24)),
]
AUTHORS_POINTS = np.array([(x, y, z) for x, y, heights, _ in AUTHORS for z in heights], float)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int16])
def test_points_fall_into_the_authors_bins(dtype: type) -> None:
    points = AUTHORS_POINTS
    if dtype is np.int16:
        # (7, 0.1) becomes (7, 0), which is in the same bin.
        points = AUTHORS_POINTS.round()
    expected = np.zeros((40, 120), np.float32)
    for *_, found in AUTHORS:
        if found:
            expected[found[:2]] = found[2]
    image = ScanContext()(points.astype(dtype))
    np.testing.assert_array_equal(image, expected)
    assert image.dtype == np.float32
    # The ring key, the share of bins that are not empty: 1/120 in six rings (the 1-based 3, 4, 6,
    # 11, 29, 40).
    np.testing.assert_array_equal(
        np.flatnonzero((image != 0).mean(axis=1)) + 1, [3, 4, 6, 11, 29, 40]
    )


def test_mirroring_turns_the_sectors_clockwise() -> None:
    # +y, sector 29 of (87°, 90°], becomes −y: 270° lies in (267°, 270°], sector 89. The axis x
    # keeps 0 and 59.
    image = ScanContext(mirror=True)(AUTHORS_POINTS)
    assert image[5, 89] == 1
    assert image[10, 59] == 7
    assert image[2, 0] == 24
    assert image[28, 44] == -5  # −135° becomes 135°, the end of (132°, 135°]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("beyond", ["last_ring", "drop"])
@pytest.mark.parametrize(
    "shape", [(40, 120, 80.0), (20, 60, 80.0), (7, 11, 33.3), (1, 1, 10.0), (16, 360, 50.0)]
)
def test_every_bin_is_exact(shape: tuple[int, int, float], beyond: str, dtype: type) -> None:
    view = ScanContext(*shape, beyond=beyond, **RAW)  # type: ignore[arg-type]
    points = cloud(1, dtype, shape[2])
    np.testing.assert_array_equal(view(points), definition(points, view))


def test_points_are_averaged_in_cubes_first() -> None:
    # At (10.1, 0.2): five points in one 0.5 m cube, mean z 0.2; the lowest corner of the cloud
    # starts the grid. As they are, the highest counts.
    column = np.array([[10.1, 0.2, z] for z in (0.0, 0.1, 0.2, 0.3, 0.4)])
    assert ScanContext(voxel_m=0.5, min_points=1)(column)[5, 0] == np.float32(0.2)
    assert ScanContext(voxel_m=0.0, min_points=1)(column)[5, 0] == np.float32(0.4)
    assert not ScanContext(voxel_m=0.5, min_points=5)(column).any()


@pytest.mark.parametrize("voxel_m", [0.0, 0.5])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("at", [(0, 0), (700, 1), (1999, 2)])
def test_a_point_that_is_no_number_is_refused(
    voxel_m: float, bad: float, at: tuple[int, int]
) -> None:
    points = np.random.default_rng(5).uniform(-50, 50, (2000, 3))
    points[at] = bad
    with pytest.raises(InputError, match="NaN or infinite"):
        ScanContext(voxel_m=voxel_m)(points)


@pytest.mark.parametrize(
    "view", [ScanContext(), ScanContext(voxel_m=0.0), ScanContext(mirror=True)]
)
def test_an_empty_cloud_is_an_empty_image(view: ScanContext) -> None:
    image = view(np.empty((0, 3)))
    assert image.shape == (40, 120)
    assert not image.any()


@pytest.mark.parametrize("shape", [(3,), (4, 2), (4, 4), (2, 3, 3)])
def test_points_need_three_coordinates(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="shape"):
        ScanContext()(np.zeros(shape))


@pytest.mark.parametrize(
    ("mirror", "filled", "lowest", "mean", "shades", "shaded"),
    [(False, 250, -2.2021, 0.340078, 27_921, 230), (True, 251, -2.2036, 0.339977, 28_017, 227)],
)
def test_a_real_scan_gives_the_authors_numbers(
    real: Path, mirror: bool, filled: int, lowest: float, mean: float, shades: int, shaded: int
) -> None:
    image = ScanContext(mirror=mirror)(
        read_velodyne_sync(real / "nclt/2012-01-15/velodyne_sync/1326652795280148.bin")
    )
    assert np.count_nonzero(image) == filled
    assert float(image.max()) == pytest.approx(18.26, abs=1e-4)
    assert float(image.min()) == pytest.approx(lowest, abs=5e-5)
    assert float(image.mean(dtype=np.float64)) == pytest.approx(mean, abs=5e-7)
    assert (int(quantize(image).sum()), np.count_nonzero(quantize(image))) == (shades, shaded)
