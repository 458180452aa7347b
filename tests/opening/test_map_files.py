"""Tests how a point-cloud map on disk is found, read in chunks and refused."""

import hashlib
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.formats import autoware, pcd, ply
from pipeline.opening import map_files
from pipeline.opening.map_files import MapFiles
from tests.readers.damage import one_line

POINTS = np.array([[0, 0, 0], [30, 0, 1], [30, 40, 2], [0, 40, 3.5]])


def read(*paths: Path) -> NDArray[np.float64]:
    chunks = list(MapFiles.of(paths).chunks(Progress()))
    assert all(0 < len(chunk) <= map_files.MOST_POINTS for chunk in chunks)
    return np.concatenate(chunks)


def write(path: Path, points: NDArray[np.float64] = POINTS) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(ply.encode(points) if path.suffix.lower() == ".ply" else pcd.encode(points))
    return path


def write_las(path: Path, points: NDArray[np.float64], scale: float = 0.001) -> Path:
    head = laspy.LasHeader(point_format=0, version="1.2")
    head.scales = np.full(3, scale)
    record = laspy.LasData(head)
    record.x, record.y, record.z = points.T
    record.write(path)
    return path


UTM_M = np.array([690_000, 4_000_000, 500])


def metadata(folder: Path, *tiles: str) -> Path:
    text = "x_resolution: 20.0\ny_resolution: 20.0\n"
    text += "".join(f"{tile}: [{20 * index}, 0]\n" for index, tile in enumerate(tiles))
    (folder / autoware.METADATA).write_text(text)
    return folder / autoware.METADATA


@pytest.mark.parametrize("name", ["city.pcd", "city.ply", "CITY.PCD", "City.Ply"])
def test_a_file_is_a_map_whatever_the_case_of_its_suffix(tmp_path: Path, name: str) -> None:
    found = MapFiles.of([write(tmp_path / name)])
    assert found.files == (tmp_path / name,)
    assert found.name == Path(name).stem
    np.testing.assert_array_equal(read(tmp_path / name), POINTS)


def test_tiles_of_several_formats_are_read_in_the_order_of_their_names(tmp_path: Path) -> None:
    write(tmp_path / "town" / "b.PLY", POINTS + 100)
    write(tmp_path / "town" / "a.pcd", POINTS)
    write_las(tmp_path / "town" / "c.las", POINTS + 200)
    write_las(tmp_path / "town" / "d.laz", POINTS + 300)
    (tmp_path / "town" / ".c.pcd").write_text("hidden")
    (tmp_path / "town" / "lanelet2_map.osm").write_text("")
    found = MapFiles.of([tmp_path / "town"])
    assert [path.name for path in found.files] == ["a.pcd", "b.PLY", "c.las", "d.laz"]
    assert found.name == "town"
    assert found.are_float32 == (True, True, False, False)
    expected = np.concatenate([POINTS, POINTS + 100, POINTS + 200, POINTS + 300])
    np.testing.assert_allclose(read(tmp_path / "town"), expected, atol=1e-9)


def test_several_paths_make_one_map_and_a_file_named_twice_is_read_once(tmp_path: Path) -> None:
    east = write(tmp_path / "east.pcd", POINTS + 100)
    write(tmp_path / "west" / "a.pcd", POINTS)
    found = MapFiles.of([east, tmp_path / "west", tmp_path / "west" / ".." / "east.pcd"])
    assert [path.name for path in found.files] == ["a.pcd", "east.pcd"]
    assert found.name == "east"


@pytest.mark.parametrize("name", ["pointcloud_map", "pointcloud_map.pcd"])
@pytest.mark.parametrize("is_beside_tiles", [True, False])
@pytest.mark.parametrize("given", ["map", "tiles", "yaml"])
def test_autowares_map_is_found_from_its_folders_and_its_metadata(
    tmp_path: Path, name: str, is_beside_tiles: bool, given: str
) -> None:
    root = tmp_path / "nishi"
    tiles = root / name
    write(tiles / "A.pcd")
    write(tiles / "B.pcd", POINTS + 20)
    write(tiles / "old.pcd", POINTS + 900)
    (root / "lanelet2_map.osm").write_text("")
    (root / "map_projector_info.yaml").write_text("projector_type: local\n")
    written = metadata(tiles if is_beside_tiles else root, "A.pcd", "B.pcd")
    path = {"map": root, "tiles": tiles, "yaml": written}[given]
    found = MapFiles.of([path])
    assert found.files == (tiles / "A.pcd", tiles / "B.pcd")
    assert found.notes == (f"{tiles}: {autoware.METADATA} does not name old.pcd, left out",)
    is_root = given == "map" or (given == "yaml" and not is_beside_tiles)
    assert found.name == ("nishi" if is_root else "pointcloud_map")


def test_metadata_of_other_tiles_beside_the_folder_are_not_these_tiles(tmp_path: Path) -> None:
    write(tmp_path / "site" / "mine.pcd")
    metadata(tmp_path, "theirs.pcd")
    assert MapFiles.of([tmp_path / "site"]).files == (tmp_path / "site" / "mine.pcd",)


def test_a_written_folder_of_tiles_is_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform([-50, -50, 0], [50, 50, 9], (500, 3)).astype(np.float32).astype(float)
    autoware.write_tiles(tmp_path / "pointcloud_map", [points[:300], points[300:]], 20)
    found = read(tmp_path / "pointcloud_map")
    np.testing.assert_array_equal(found[np.lexsort(found.T)], points[np.lexsort(points.T)])
    # 100 m by 100 m are cut at -40, -20, 0, 20 and 40: six by six tiles
    assert len(MapFiles.of([tmp_path / "pointcloud_map"]).files) == 36


def test_chunks_are_bounded_and_points_that_are_not_finite_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_files, "MOST_POINTS", 2)
    points = np.concatenate([POINTS, np.full((2, 3), np.nan), [[1, np.inf, 0], [1, 2, -1]]])
    found = MapFiles.of([write(tmp_path / "city.pcd", points)])
    for _ in range(2):  # a second pass starts its counts at 0
        chunks = list(found.chunks(Progress()))
        # the third block of two is left out whole, half of the fourth
        assert [len(chunk) for chunk in chunks] == [2, 2, 1]
        np.testing.assert_array_equal(np.concatenate(chunks), points[[0, 1, 2, 3, 7]])
        assert (found.tally.points, found.tally.left_out) == (5, 3)
        np.testing.assert_array_equal(found.tally.low_m, [0, 0, -1])
        np.testing.assert_array_equal(found.tally.high_m, [30, 40, 3.5])


def test_progress_is_shown_over_the_blocks_of_all_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Counted(Progress):
        def track(self, items, total, what):
            shown.append([total, 0])
            for item in items:
                shown[-1][1] += 1
                yield item

    shown: list[list[int]] = []
    monkeypatch.setattr(map_files, "MOST_POINTS", 3)
    write(tmp_path / "a.pcd")
    write(tmp_path / "b.ply")
    list(MapFiles.of([tmp_path]).chunks(Counted()))
    # two files of four points, in blocks of three and one
    assert shown == [[4, 4]]


def test_the_step_of_32_bit_floats_is_that_at_the_farthest_coordinate(tmp_path: Path) -> None:
    # from 2^21 to 2^22 = 4,194,304 neighbours of 24 bits are 2^-2 apart
    found = MapFiles.of([write(tmp_path / "utm.pcd", POINTS + UTM_M)])
    list(found.chunks(Progress()))
    assert found.are_float32 == (True,)
    assert found.tally.step_m == 0.25
    found = MapFiles.of([write_las(tmp_path / "utm.las", POINTS + UTM_M / 4)])
    list(found.chunks(Progress()))
    assert found.are_float32 == (False,)
    assert found.tally.step_m == 0


def test_doubles_in_utm_stay_doubles(tmp_path: Path) -> None:
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 2\nDATA binary\n"
    rows = [[690_000.001, 4_000_000.002, 500.003], [690_050, 4_000_000, 501]]
    path = tmp_path / "utm.pcd"
    path.write_bytes(head.encode() + struct.pack("<6d", *rows[0], *rows[1]))
    np.testing.assert_array_equal(read(path), rows)


def test_of_the_voxels_of_an_ndt_map_the_means_are_read(tmp_path: Path) -> None:
    fields = "x y z icov_xx icov_xy icov_xz icov_yy icov_yz icov_zz numpoints"
    head = (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {'4 ' * 10}\nTYPE {'F ' * 9}U\nCOUNT {'1 ' * 10}\n"
        "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n"
    )
    path = tmp_path / "ndt.pcd"
    rows = [struct.pack("<9fI", 2 * i, 1, i, *6 * [0.1], 12) for i in range(2)]
    path.write_bytes(head.encode() + b"".join(rows))
    np.testing.assert_array_equal(read(path), [[0, 1, 0], [2, 1, 1]])


def test_the_digest_is_of_names_and_bytes(tmp_path: Path) -> None:
    path = write(tmp_path / "a" / "city.pcd")
    same = write(tmp_path / "b" / "city.pcd")
    content = hashlib.md5(path.read_bytes()).hexdigest()
    expected = hashlib.md5(f"city.pcd\0{content}\0".encode()).hexdigest()
    assert MapFiles.of([path]).digest() == MapFiles.of([same]).digest() == expected
    digests = {
        MapFiles.of(paths).digest()
        for paths in (
            [path],
            [path, write(tmp_path / "a" / "more.pcd")],
            [write(tmp_path / "b" / "town.pcd")],
            [write(tmp_path / "c" / "city.pcd", POINTS + 1)],
        )
    }
    assert len(digests) == 4


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("lost.pcd", "no such map; expected a .pcd"),
        ("scan.bin", "one scan, not a map; expected .pcd"),
        ("scan.npy", "one scan, not a map; expected .pcd"),
        ("mesh.STL", "a mesh, whose corners are no scan of its surfaces: sample points on it"),
        ("city.e57", "no point-cloud map that is read; expected .pcd, .ply, .las or .laz"),
        ("hall.yaml", "no point-cloud map that is read"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, name: str, says: str) -> None:
    path = tmp_path / name
    if not name.startswith("lost"):
        path.write_bytes(bytes(16))
    with one_line(LogError, f"^{path}: {says}"):
        MapFiles.of([path])


def test_no_path_is_refused() -> None:
    with one_line(LogError, "^no map named; expected .pcd"):
        MapFiles.of([])


def test_a_folder_without_tiles_is_refused(tmp_path: Path) -> None:
    (tmp_path / ".hidden.pcd").write_text("")
    with one_line(LogError, f"^{tmp_path}: holds no .pcd, .ply, .las or .laz, and no folder"):
        MapFiles.of([tmp_path])
    (tmp_path / "0001.bin").write_text("")
    with one_line(LogError, f"^{tmp_path}: holds scans, not a map"):
        MapFiles.of([tmp_path])
    write(tmp_path / "day" / "a.pcd")
    write(tmp_path / "night" / "a.pcd")
    with one_line(LogError, rf"^{tmp_path}: 2 folders in it hold clouds \(day, night\); name one"):
        MapFiles.of([tmp_path])


def test_a_tile_that_the_metadata_names_and_that_is_missing_is_named(tmp_path: Path) -> None:
    path = metadata(tmp_path, "A.pcd", "B.pcd", "C.pcd")
    with one_line(LogError, rf"^{tmp_path}: no tile A.pcd, .* \(3 of 3 are missing\)"):
        MapFiles.of([tmp_path])
    write(tmp_path / "tiles" / "A.pcd")
    write(tmp_path / "tiles" / "C.pcd")
    for given in (tmp_path, tmp_path / "tiles", path):
        with one_line(LogError, rf"^{tmp_path}/tiles: no tile B.pcd, .* \(1 of 3 are missing\)"):
            MapFiles.of([given])
    metadata(tmp_path)
    with one_line(LogError, f"^{path}: names no tile"):
        MapFiles.of([tmp_path])


NO_FACES = "element face 0\nproperty list uchar int vertex_indices\nend_header\n"
FACES = NO_FACES.replace("face 0", "face 1")


def test_a_mesh_is_refused_and_a_cloud_with_an_empty_list_of_faces_is_not(tmp_path: Path) -> None:
    path = tmp_path / "hall.ply"
    data = ply.encode(POINTS)
    path.write_bytes(data.replace(b"end_header\n", NO_FACES.encode()))
    np.testing.assert_array_equal(read(path), POINTS)
    path.write_bytes(
        data.replace(b"end_header\n", FACES.encode()) + struct.pack("<B3i", 3, 0, 1, 2)
    )
    with one_line(LogError, f"^{path}: 1 faces, a mesh, whose corners are no scan"):
        read(path)


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (POINTS[:0], "holds no points"),
        (np.full((3, 3), np.nan), "none of its 3 points is finite"),
        (POINTS * [1, 1, 0], "all points have the height 0, a 2-D map; .* the .yaml of a Nav2"),
        (POINTS * 1e-5, "span 0.000300 x 0.000400, which is no map in metres; project degrees"),
    ],
)
def test_points_that_make_no_map_are_refused(
    tmp_path: Path, points: NDArray[np.float64], says: str
) -> None:
    path = write(tmp_path / "city.pcd", points)
    with one_line(LogError, f"^{path}: .*{says}"):
        read(path)


def test_points_without_a_height_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "hall.pcd"
    path.write_bytes(pcd.encode(POINTS).replace(b"FIELDS x y z", b"FIELDS x y i"))
    with one_line(LogError, f"^{path}: its fields are x y i; .* the .yaml of Nav2"):
        read(path)


def test_an_empty_tile_among_others_is_no_error(tmp_path: Path) -> None:
    write(tmp_path / "a.pcd", POINTS[:0])
    write(tmp_path / "b.pcd")
    np.testing.assert_array_equal(read(tmp_path), POINTS)


def hall(count: int = 4000) -> NDArray[np.float64]:
    """The points of a hall of 60 m by 40 m, 5 m high, with walls and a floor, in m."""
    rng = np.random.default_rng(2)
    floor = rng.uniform([0, 0, 0], [60, 40, 0.01], (count // 2, 3))
    walls = rng.uniform([0, 0, 0], [60, 0.01, 5], (count // 2, 3))
    return np.concatenate([floor, walls])


def test_coordinates_in_millimetres_are_refused(tmp_path: Path) -> None:
    # 5 m of height are 5,000 mm; a field of 60 m is 60,000 mm wide, its points some 500 mm apart
    path = write(tmp_path / "hall.pcd", 1000 * hall())
    with one_line(LogError, f"^{path}: .* too far for metres; if they are millimetres, divide"):
        read(path)
    field = write(tmp_path / "field.pcd", 1000 * hall() * [1, 1, 0.01])
    with one_line(LogError, f"^{field}: .* too far for metres; if they are millimetres, divide"):
        read(field)


def test_stray_points_and_a_long_road_are_metres(tmp_path: Path) -> None:
    stray = np.concatenate([hall(), [[0, 0, 9e4], [1e6, 0, 0]]])
    assert len(read(write(tmp_path / "hall.pcd", stray))) == 4002
    # 60 km with a point every 2 m
    x_m = np.arange(0, 60_000, 2.0)
    road = np.column_stack([x_m, np.zeros_like(x_m), 5 * np.sin(x_m)])
    assert len(read(write(tmp_path / "road.pcd", road))) == 30_000


def test_a_folder_of_scans_in_the_frame_of_the_sensor_is_no_map(tmp_path: Path) -> None:
    for index in range(10):
        write(tmp_path / "scans" / f"{index:06d}.pcd", hall(200) - [30 + index, 20, 1])
    with one_line(LogError, f"^{tmp_path}/scans: each of its 10 files surrounds the origin"):
        read(tmp_path / "scans")
    write(tmp_path / "scans" / "far.pcd", hall(200) + 100)
    assert len(read(tmp_path / "scans")) == 11 * 200


@pytest.mark.parametrize("name", ["city.pcd", "city.ply", "city.las", "city.laz"])
def test_a_file_that_is_cut_short_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    (write_las if "las" in name or "laz" in name else write)(path, POINTS)
    path.write_bytes(path.read_bytes()[:-20])
    with one_line(LogError, f"^{path}: "):
        read(path)


def test_the_tiles_of_a_real_map_are_read(real: Path) -> None:
    """560 tiles of a campus; their headers' POINTS sum up to 5,051,995."""
    found = MapFiles.of([real / "nova" / "map"])
    assert len(found.files) == 560
    assert sum(summary.points for summary in found.summaries) == 5_051_995
    assert sum(len(chunk) for chunk in found.chunks(Progress())) == 5_051_995
    assert found.tally.left_out == 0
