"""The map of a site leaves it as a point cloud, of which the same site can be packed again."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.cli import main
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.formats import nav2_map, ply
from pipeline.mapping.tiled_map import GRAIN_M, TiledMap
from pipeline.online import export_map, site_file
from pipeline.online.map_pack import VOXEL_M
from pipeline.opening.map_files import MapFiles
from tests.level.hall import map_of_hall
from tests.online import made
from tests.posing.scene import planar, scene
from tests.readers.damage import one_line


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of a 3-D map, whose origin is not that of its world."""
    folder = tmp_path_factory.mktemp("city")
    (folder / "city.ply").write_bytes(ply.encode(scene(1) + np.array([1000, 2000, 30])))
    out = folder / "city.site"
    main(["pack", "--map", str(folder / "city.ply"), "--origin", "1000,2000,30", "-o", str(out)])
    return out


def points_of(path: Path) -> NDArray[np.float64]:
    return np.concatenate([*MapFiles.of([path]).chunks(Progress())])


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The line with which the command `yearloc` refuses."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 1
    return capsys.readouterr().err.strip()


@pytest.mark.parametrize("name", ["again.pcd", "again.ply", "again/"])
def test_a_map_site_packed_of_its_export_is_the_same(
    city: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = f"{tmp_path}/{name}"
    main(["export", str(city), "-o", out])
    reported = capsys.readouterr()
    assert " points" in reported.out
    assert "simulated" not in reported.err
    main(["pack", "--map", out, "-o", str(tmp_path / "again.site")])
    first, second = (site_file.read(path) for path in (city, tmp_path / "again.site"))
    # a mean that is rounded over the border of its voxel joins the neighbouring one
    maps = [TiledMap.of_arrays(parts.arrays) for parts in (first, second)]
    clouds = [np.concatenate([*tiled.tiles_m()]) for tiled in maps]
    assert len(clouds[1]) > 0.99 * len(clouds[0])
    distance_m, _ = KDTree(clouds[0]).query(clouds[1])
    assert np.quantile(distance_m, 0.99) < 2 * GRAIN_M
    anchors = [parts.arrays["world_T_anchor"] for parts in (first, second)]
    np.testing.assert_allclose(anchors[1], anchors[0], atol=2 * GRAIN_M)
    np.testing.assert_array_equal(second.model["walls/corner_m"], first.model["walls/corner_m"])
    walls = [parts.model["walls/counts"] > 0 for parts in (first, second)]
    assert walls[0].any()
    assert (walls[0] == walls[1]).mean() > 0.99


def test_the_submaps_of_a_drive_are_joined_in_the_world(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "three.ply"
    main(["export", str(made.packed(tmp_path)), "-o", str(out)])
    assert "the site is simulated, not recorded" in capsys.readouterr().err
    assert b"comment simulated, not recorded\n" in out.read_bytes()[:120]
    points_m = points_of(out)
    world_m = np.concatenate(
        [transformed(made.ANCHORS[row], scene(row)) for row in range(len(made.ANCHORS))]
    )
    distance_m, _ = KDTree(points_m).query(world_m)
    assert distance_m.max() < VOXEL_M * np.sqrt(3)  # each point has the mean of its voxel near
    distance_m, _ = KDTree(world_m).query(points_m)
    assert distance_m.max() < VOXEL_M * np.sqrt(3)


def test_a_place_that_two_submaps_show_is_there_once() -> None:
    model, arrays = made.arrays()
    points = np.array([[0, 0, 0], [500, 0, 0]])  # 5 m apart
    arrays |= {
        "points": np.concatenate([points, points - [100, 0, 0]]),
        "offsets": np.array([0, 2, 4]),
        "world_T_anchor": np.array([planar(0.2, 0.2, 0), planar(1.2, 0.2, 0)]),
    }
    parts = site_file.Parts(made.described(), model, arrays, None)
    tiled = export_map.world_map(parts, Progress())
    np.testing.assert_allclose(
        np.concatenate([*tiled.tiles_m()]), [[0.2, 0.2, 0], [5.2, 0.2, 0]], atol=1e-6
    )


def test_a_level_site_gives_its_nav2_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hall = map_of_hall(tmp_path)
    main(["pack", "--map", str(hall), "-o", str(tmp_path / "hall.site")])
    main(["export", str(tmp_path / "hall.site"), "-o", str(tmp_path / "again.yaml")])
    first, second = (nav2_map.read(tmp_path / f"{name}.yaml") for name in ("hall", "again"))
    np.testing.assert_array_equal(second.occupancy, first.occupancy)
    assert second.origin == first.origin
    assert second.resolution_m == first.resolution_m
    capsys.readouterr()
    said = refused(["export", str(tmp_path / "hall.site"), "-o", str(tmp_path / "h.pcd")], capsys)
    assert said.endswith("the map of a site of a level laser is a Nav2 map, FILE.yaml")


def test_what_a_site_has_not_is_refused_in_one_line(
    city: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, option, says in (
        ("city.onnx", [], "city.site is the site of a 3-D map, which has no network"),
        ("other.site", [], "city.site is the site of a 3-D map, which has no network"),
        ("city.yaml", [], "the map of a site of 3-D scans is FILE.pcd, FILE.ply or FOLDER/"),
        ("city.xyz", [], "expected a map FILE.pcd, FILE.ply or a folder of tiles"),
        ("city.pcd", ["--compact"], "--compact is for a network"),
    ):
        said = refused(["export", str(city), "-o", str(tmp_path / name), *option], capsys)
        assert says in said
        assert "\n" not in said
    assert not list(tmp_path.iterdir())


def test_a_site_whose_points_do_not_fit_is_called_so(tmp_path: Path) -> None:
    model, arrays = made.arrays()
    parts = site_file.Parts(made.described(), model, arrays | {"offsets": np.arange(2)}, None)
    site_file.write(tmp_path / "three.site", parts)
    with one_line(ArtifactError, "its parts do not fit together .*; pack the site again"):
        export_map.export_map(tmp_path / "three.site", str(tmp_path / "map.pcd"), Progress())
