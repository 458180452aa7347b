"""Tests Nav2's maps: the cell that its map server makes of each pixel, and round trips."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import ArtifactError
from pipeline.formats.nav2_map import GridMap, read, write

YAML = """image: hall.pgm
resolution: 0.05
origin: [-3.5, 2.0, 0.5]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.25
mode: {mode}
"""


def saved(folder: Path, pixels: list[list[int]], mode: str = "trinary", negate: int = 0) -> Path:
    """Write a map of these pixels, and return its yaml; the image is text (P2) with a comment."""
    rows = "\n".join(" ".join(map(str, row)) for row in pixels)
    size = f"{len(pixels[0])} {len(pixels)}"
    (folder / "hall.pgm").write_text(f"P2\n# CREATOR: map_saver\n{size}\n255\n{rows}\n")
    path = folder / "hall.yaml"
    path.write_text(YAML.format(mode=mode, negate=negate))
    return path


@pytest.mark.parametrize(
    ("mode", "negate", "cells"),
    [
        # shades 0, 205/255 = .804, 254/255, 112/255 = .439: occupied 1, .196, .004, .561
        ("trinary", 0, [[100, 0, 0, -1]]),
        # of shares between the thresholds (.561 − .25) / .4 = 77.7 %
        ("scale", 0, [[100, 0, 0, 78]]),
        # occupied shares are the shades: 0, .804, .996, .439; (.439 − .25) / .4 = 47.3 %
        ("trinary", 1, [[0, 100, 100, -1]]),
        ("scale", 1, [[0, 100, 100, 47]]),
        ("raw", 0, [[0, -1, -1, -1]]),
    ],
)
def test_a_pixel_is_what_nav2_makes_of_it(
    tmp_path: Path, mode: str, negate: int, cells: list[list[int]]
) -> None:
    grid = read(saved(tmp_path, [[0, 205, 254, 112]], mode, negate))
    np.testing.assert_array_equal(grid.occupancy, cells)
    assert grid.resolution_m == 0.05
    assert grid.origin == (-3.5, 2.0, 0.5)


def test_the_images_lowest_row_is_row_0(tmp_path: Path) -> None:
    grid = read(saved(tmp_path, [[0, 254], [254, 254]]))
    np.testing.assert_array_equal(grid.occupancy, [[0, 0], [100, 0]])


def test_a_written_map_is_read_as_it_was(tmp_path: Path) -> None:
    cells = np.random.default_rng(0).choice([-1, 0, 100], (23, 31)).astype(np.int8)
    write(tmp_path / "hall.yaml", GridMap(cells, 0.05, (-1.25, 3.0, 0.7)))
    again = read(tmp_path / "hall.yaml")
    np.testing.assert_array_equal(again.occupancy, cells)
    assert (again.resolution_m, again.origin) == (0.05, (-1.25, 3.0, 0.7))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("resolution: 0.05", "resolution: fine", "resolution=fine: expected a number"),
        ("resolution: 0.05", "", "not given: resolution"),
        ("origin: [-3.5, 2.0, 0.5]", "origin: [1, 2]", "origin=.*: expected a list of 3"),
        ("origin: [-3.5, 2.0, 0.5]", "origin: [1, 2, .nan]", "origin.2.=nan: expected a number"),
        ("mode: trinary", "mode: grey", "expected trinary, scale or raw"),
        ("negate: 0", "negate: maybe", "expected 0 or 1"),
        ("free_thresh: 0.25", "free_thresh: 0.8", "expected 0 <= free < occupied"),
        ("image: hall.pgm", "image: 7", "image=7: expected a word"),
        ("image: hall.pgm", "image: other.pgm", "no such image"),
        (YAML.format(mode="trinary", negate=0), "- a list", "no map"),
        (YAML.format(mode="trinary", negate=0), "{{{", "no map"),
    ],
)
def test_a_wrong_key_raises_an_error_of_one_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = saved(tmp_path, [[0, 254]])
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ArtifactError, match=message) as error:
        read(path)
    assert "\n" not in str(error.value)


def test_damaged_images_raise_an_error_of_one_line(tmp_path: Path) -> None:
    path = saved(tmp_path, [[0, 254]])
    for data in (b"", b"P5\n9 9\n255\nshort", b"P5\n90000 90000\n255\n", b"\x00" * 99):
        (tmp_path / "hall.pgm").write_bytes(data)
        with pytest.raises(ArtifactError, match=r"hall\.pgm"):
            read(path)
    with pytest.raises(ArtifactError, match="no such map"):
        read(tmp_path / "none.yaml")
