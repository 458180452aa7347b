"""A map is written as a file or as tiles, in floats that keep its coordinates to a centimetre."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.formats import autoware, pcd, ply
from pipeline.mapping.map_output import MapOutput
from pipeline.mapping.tiled_map import Thinning, TiledMap
from pipeline.opening.map_files import MapFiles
from tests.readers.damage import one_line

POINTS_M = np.array([[-3, 2, 0.25], [1, 1, 0], [61, 2, 1.5], [61, 77, -2]])
UTM_M = np.array([690_000, 4_000_000, 500])


def tiled(points_m: NDArray[np.float64]) -> TiledMap:
    """A map of these points, none of which are in one voxel."""
    thinning = Thinning(0.5)
    thinning.add(points_m)
    return thinning.tiled()


def rows(points_m: NDArray[np.float64]) -> list[list[float]]:
    """The points in ascending order, to whole centimetres."""
    return sorted(np.round(points_m, 2).tolist())


def read(path: Path) -> NDArray[np.float64]:
    return np.concatenate([*MapFiles.of([path]).chunks(Progress())])


@pytest.mark.parametrize(
    ("name", "holder"), [("map.pcd", "."), ("map.ply", "."), ("map/", "map"), ("map.v2/", "map.v2")]
)
def test_a_map_is_read_as_it_was_written(tmp_path: Path, name: str, holder: str) -> None:
    output = MapOutput.of(f"{tmp_path}/{name}")
    assert output.is_folder == (holder != ".")
    lines = output.write(tiled(POINTS_M))
    assert "4 points" in lines[0]
    assert len(lines) == 1
    assert rows(read(output.path)) == rows(POINTS_M)
    assert set(MapFiles.of([output.path]).are_float32) == {True}


def test_tiles_are_of_20_m_and_named_after_their_corners(tmp_path: Path) -> None:
    MapOutput.of(f"{tmp_path}/map/").write(tiled(POINTS_M))
    metadata = autoware.read_metadata(tmp_path / "map" / autoware.METADATA)
    corners = {"-20_0.pcd": (-20, 0), "0_0.pcd": (0, 0), "60_0.pcd": (60, 0), "60_60.pcd": (60, 60)}
    assert metadata == autoware.Metadata((20, 20), corners)


@pytest.mark.parametrize(
    ("name", "line"), [("map.pcd", b"# of a dream\n"), ("map.ply", b"comment of a dream\n")]
)
def test_a_comment_heads_a_file(tmp_path: Path, name: str, line: bytes) -> None:
    MapOutput.of(str(tmp_path / name)).write(tiled(POINTS_M), "of a dream")
    assert line in (tmp_path / name).read_bytes()[:80]
    assert rows(read(tmp_path / name)) == rows(POINTS_M)


def test_a_comment_heads_the_tiles_and_their_yaml(tmp_path: Path) -> None:
    MapOutput.of(f"{tmp_path}/map/").write(tiled(POINTS_M), "of a dream")
    assert all(
        path.read_bytes().startswith(b"# of a dream\n") for path in (tmp_path / "map").iterdir()
    )
    assert rows(read(tmp_path / "map")) == rows(POINTS_M)


@pytest.mark.parametrize("name", ["map.pcd", "map.ply"])
def test_far_coordinates_are_stored_in_64_bits(tmp_path: Path, name: str) -> None:
    """Neighbouring 32-bit floats are .25 m apart at 4,000 km."""
    lines = MapOutput.of(str(tmp_path / name)).write(tiled(POINTS_M + UTM_M))
    assert "coordinates reach 4,000 km, where 32-bit floats round by 0.12 m" in lines[1]
    assert rows(read(tmp_path / name)) == rows(POINTS_M + UTM_M)
    summary = {".pcd": pcd.summary, ".ply": ply.summary}[Path(name).suffix](tmp_path / name)
    assert not summary.is_float32


def test_coordinates_are_far_from_262_km_on(tmp_path: Path) -> None:
    """From 2^18 m = 262,144 m on, neighbours are 1/32 m apart, so they round by 1.6 cm."""
    output = MapOutput.of(str(tmp_path / "map.ply"))
    for x_m, is_float32 in ((262_100, True), (262_200, False)):
        output.write(tiled(np.array([[x_m, 0.0, 0.0]])))
        assert ply.summary(output.path).is_float32 == is_float32


def test_tiles_of_far_coordinates_are_refused_as_autoware_reads_32_bits(tmp_path: Path) -> None:
    with one_line(ConfigError, "4,000 km.*write FILE.ply, or pack the map with --origin"):
        MapOutput.of(f"{tmp_path}/map/").write(tiled(POINTS_M + UTM_M))
    assert not list(tmp_path.iterdir())


def test_what_is_no_output_of_a_map_is_refused(tmp_path: Path) -> None:
    with one_line(ConfigError, "map.xyz: expected a map FILE.pcd, FILE.ply or a folder"):
        MapOutput.of(str(tmp_path / "map.xyz"))
    (tmp_path / "thesis.tex").write_text("")
    with one_line(ConfigError, "holds thesis.tex beside tiles; name a new folder"):
        MapOutput.of(str(tmp_path))
    empty = TiledMap(np.empty((0, 3), np.int16), np.zeros(1, np.int64), np.empty((0, 3)))
    with one_line(InputError, "a map without points, nothing was written"):
        MapOutput.of(str(tmp_path / "map.pcd")).write(empty)
    assert not (tmp_path / "map.pcd").exists()
