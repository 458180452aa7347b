"""Tests Autoware's tiles and their metadata, with the example of autoware_map_loader's README."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.core.errors import ConfigError, InputError, LogError
from pipeline.formats import autoware, pcd
from tests.readers.damage import one_line

EXAMPLE = """x_resolution: 20.0
y_resolution: 30
A.pcd: [1200, 2500] # -> 1200 < x < 1220, 2500 < y < 2530
B.pcd: [1220, 2500.5]
"""


def metadata(folder: Path, text: str) -> autoware.Metadata | None:
    path = folder / autoware.METADATA
    path.write_text(text)
    return autoware.read_metadata(path)


def test_the_metadata_names_tiles_and_their_corners(tmp_path: Path) -> None:
    assert metadata(tmp_path, EXAMPLE) == autoware.Metadata(
        (20.0, 30.0), {"A.pcd": (1200.0, 2500.0), "B.pcd": (1220.0, 2500.5)}
    )


@pytest.mark.parametrize(
    "text",
    ["", "image: hall.pgm\nresolution: 0.05\n", "# x_resolution y_resolution\nA.pcd: [1, 2]\n"],
)
def test_another_yaml_is_no_metadata(tmp_path: Path, text: str) -> None:
    assert metadata(tmp_path, text) is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (EXAMPLE.replace("[1200, 2500]", "[1200]"), r"A.pcd: \[1200\]; expected the tile's least"),
        (EXAMPLE.replace("[1200, 2500]", "[1200, b]"), "A.pcd: b; expected metres"),
        (EXAMPLE.replace("20.0", ".nan"), "x_resolution: nan; expected metres"),
        (EXAMPLE + "C.pcd: [", "no readable metadata"),
        ("- x_resolution\n- y_resolution\n", "no readable metadata"),
    ],
)
def test_damaged_metadata_raises_an_error_of_one_line(tmp_path: Path, text: str, says: str) -> None:
    with one_line(LogError, f"^{tmp_path}/{autoware.METADATA}: {says}"):
        metadata(tmp_path, text)


def test_points_are_written_into_the_tile_of_their_corner(tmp_path: Path) -> None:
    # tiles of 20 m: -0.5 lies in that from -20, 20 in that from 20
    blocks = [
        np.array([[0, 0, 1], [19.9, 5, 2], [-0.5, 39, 3]]),
        np.array([[20, 0, 4], [1, 1, 5.0]]),
    ]
    folder = tmp_path / "pointcloud_map"
    written = autoware.write_tiles(folder, blocks, 20)
    corners = {"-20_20.pcd": (-20, 20), "0_0.pcd": (0, 0), "20_0.pcd": (20, 0)}
    assert written == autoware.Metadata((20, 20), corners)
    assert autoware.read_metadata(folder / autoware.METADATA) == written
    assert {path.name for path in folder.iterdir()} == {*corners, autoware.METADATA}
    heights = {
        name: pcd.decode((folder / name).read_bytes(), folder, 999)[:, 2].tolist()
        for name in corners
    }
    assert heights == {"-20_20.pcd": [3], "0_0.pcd": [1, 2, 5], "20_0.pcd": [4]}


def test_corners_are_written_as_the_whole_numbers_that_the_loader_reads(tmp_path: Path) -> None:
    autoware.write_tiles(tmp_path / "map", [np.array([[61.0, -3, 0]])], 20)
    text = (tmp_path / "map" / autoware.METADATA).read_text()
    assert text == "x_resolution: 20.0\ny_resolution: 20.0\n60_-20.pcd: [60, -20]\n"
    assert [type(value) for value in yaml.safe_load(text)["60_-20.pcd"]] == [int, int]


def test_a_point_lies_in_the_tile_of_its_stored_coordinates(tmp_path: Path) -> None:
    # as a 32-bit float 20 - 1e-9 is 20
    written = autoware.write_tiles(tmp_path / "map", [np.array([[20 - 1e-9, 0, 0]])], 20)
    assert list(written.corners_m) == ["20_0.pcd"]


def test_a_map_is_replaced_and_another_folder_is_not(tmp_path: Path) -> None:
    folder = tmp_path / "map"
    autoware.write_tiles(folder, [np.zeros((1, 3))], 20)
    autoware.write_tiles(folder, [np.full((1, 3), 30.0)], 20)
    assert {path.name for path in folder.iterdir()} == {"20_20.pcd", autoware.METADATA}
    (folder / "thesis.tex").write_text("")
    with one_line(ConfigError, f"^{folder}: holds thesis.tex beside tiles; name a new folder$"):
        autoware.write_tiles(folder, [np.zeros((1, 3))], 20)
    with one_line(ConfigError, f"^{folder}/thesis.tex: .* name a new folder$"):
        autoware.write_tiles(folder / "thesis.tex", [np.zeros((1, 3))], 20)


@pytest.mark.parametrize(
    ("blocks", "side_m", "says"),
    [
        ([], 20, "no points to write as tiles"),
        ([np.zeros((0, 3))], 20, "no points to write as tiles"),
        ([np.array([[0, 0, np.nan]])], 20, "expected finite coordinates"),
        ([np.zeros((1, 3))], 0, "tiles of 0 m: expected at least 1 m"),
    ],
)
def test_what_makes_no_tiles_is_refused_and_leaves_no_folder(
    tmp_path: Path, blocks: list[np.ndarray], side_m: int, says: str
) -> None:
    with one_line(InputError, says):
        autoware.write_tiles(tmp_path / "map", blocks, side_m)
    assert not list(tmp_path.iterdir())
