"""A site is packed from a made 3-D map, and localises scans in it; maps that cannot be are
refused."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import distance_and_turn
from pipeline.core.progress import Progress
from pipeline.formats import autoware, pcd, ply
from pipeline.online.map_pack import (
    NEAR_M,
    MapOptions,
    pack_map,
    parts_of_points,
)
from pipeline.online.site import Site
from pipeline.posing.map_verdict import usual_verdict
from tests.commands import Command
from tests.mapping.town import scan, town
from tests.posing.scene import planar

MAP_M = town(0, 200.0)
POSES = [planar(63, 84, 10), planar(101, 63, 130), planar(142, 123, 255), planar(83, 142, 340)]


def write(path: Path, points_m: NDArray[np.float64] = MAP_M) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(ply.encode(points_m) if path.suffix == ".ply" else pcd.encode(points_m))
    return path


@pytest.fixture(scope="module")
def site() -> Site:
    return Site.of_map(MAP_M)


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    pack_map([write(folder / "town.pcd")], folder / "town.site", MapOptions(), Progress())
    return folder / "town.site"


def is_right(site: Site, points_m: NDArray[np.float64], pose: NDArray[np.float64]) -> bool:
    away_m, turn_deg = distance_and_turn(site.localize(points_m).world_T_sensor[None], pose[None])
    return bool(away_m[0] < 2 and turn_deg[0] < 5)


def test_scans_are_localised_in_a_map_of_points(site: Site) -> None:
    assert [is_right(site, scan(MAP_M, pose), pose) for pose in POSES] == [True] * 4
    fix = site.localize(scan(MAP_M, POSES[0]), 0.95)
    assert fix.verdict == "accepted"
    assert fix.place == site.place(POSES[0])
    assert site.name == "map"
    assert not site.is_level


def test_a_scan_of_another_town_is_not_accepted(site: Site) -> None:
    elsewhere_m = town(99, 200.0)
    fixes = [site.localize(scan(elsewhere_m, pose), 0.95) for pose in POSES[:2]]
    assert [fix.accepted_at for fix in fixes] == [None] * 2
    assert "near" not in {fix.verdict for fix in fixes}


@pytest.mark.parametrize("turn", ["upside down", "y up", "z forward"])
def test_a_scan_with_other_axes_than_the_map_is_not_accepted(site: Site, turn: str) -> None:
    points_m = scan(MAP_M, POSES[0])
    turned_m = {
        "upside down": points_m * [1, -1, -1],
        "y up": points_m[:, [0, 2, 1]] * [1, 1, -1],
        "z forward": points_m[:, [1, 2, 0]],
    }[turn]
    assert site.localize(turned_m, 0.95).accepted_at is None


def test_the_verdict_is_the_usual_one_and_says_nothing_of_999(site: Site) -> None:
    assert "not calibrated on this map" in site.title
    # A claim is accepted at .95 if its error probability is below .05, at .99 below .01.
    # Between them, and below .95, the threshold is that of the next of the two.
    assert usual_verdict().thresholds == site.target_precisions
    assert {precision: pose for precision, (pose, *_) in site.target_precisions.items()} == {
        **dict.fromkeys((0.9, 0.95), 0.05),
        **dict.fromkeys((0.97, 0.98, 0.985, 0.99), 0.01),
    }
    assert site.kept_words(0.999) == "this site can keep .99, not .999: accepted means .99"
    with pytest.raises(InputError, match=r"target_precision=0\.999: this site has no threshold"):
        site.localize(scan(MAP_M, POSES[0]), 0.999, strict=True)


def test_a_site_file_gives_the_same_answers_as_its_points(site: Site, packed: Path) -> None:
    opened = Site.open(packed)
    assert opened.name == "town"
    for pose in POSES[:2]:
        points_m = scan(MAP_M, pose)
        # the file's coordinates are 32-bit floats, of which the means are kept in centimetres
        here, there = site.localize(points_m), opened.localize(points_m)
        np.testing.assert_allclose(here.world_T_sensor, there.world_T_sensor, atol=0.02)
        assert here.verdict == there.verdict


def test_the_same_map_gives_the_same_bytes(packed: Path, tmp_path: Path) -> None:
    lines = pack_map(
        [packed.parent / "town.pcd"], tmp_path / "again.site", MapOptions(), Progress()
    )
    assert (tmp_path / "again.site").read_bytes() == packed.read_bytes()
    said = "\n".join(lines)
    assert "200 × 200 m" in said
    assert "ground: in the map, 0." in said
    assert "not calibrated on this map" in said


def test_an_origin_moves_the_world_of_the_site(site: Site) -> None:
    offset_m = np.array([690_000.0, 4_000_000.0, 500.0])
    moved = Site(parts_of_points(MAP_M + offset_m, "utm", MapOptions(origin_m=(*offset_m,))))
    points_m = scan(MAP_M, POSES[1])
    np.testing.assert_allclose(
        moved.localize(points_m).world_T_sensor, site.localize(points_m).world_T_sensor, atol=0.02
    )


def test_coordinates_of_utm_are_answered_in_utm() -> None:
    offset_m = np.array([690_000.0, 4_000_000.0, 500.0])
    far = Site.of_map(MAP_M + offset_m)
    pose = POSES[1].copy()
    pose[:3, 3] += offset_m
    assert is_right(far, scan(MAP_M, POSES[1]), pose)


def test_scans_of_the_robot_tell_its_sensor_and_that_the_ground_is_cut_off() -> None:
    cut_m = MAP_M[MAP_M[:, 2] > 0.6]
    like = [points_m[points_m[:, 2] > 0.6] for points_m in (scan(MAP_M, pose) for pose in POSES)]
    parts = parts_of_points(cut_m, "cut", MapOptions(like=like))
    sensor = parts.description.sensor
    assert sensor.points == np.median([len(points_m) for points_m in like])
    # The anchors stand on the ground itself, .6 m and a little below all points.
    heights_m = parts.arrays["world_T_anchor"][:, 2, 3]
    assert abs(np.median(heights_m)) < 0.3
    site = Site(parts)
    assert is_right(site, like[0], POSES[0])


def test_places_are_where_a_scan_may_have_been_taken(site: Site) -> None:
    assert site.place(POSES[0]) >= 0
    anchors_m = site.targets.world_T_anchor[:, :2, 3]
    assert (anchors_m > -NEAR_M - 8).all()
    assert (anchors_m < 200 + NEAR_M + 8).all()
    assert (site.places.at(anchors_m) >= 0).all()


def test_a_map_smaller_than_a_scan_is_searched() -> None:
    small_m = MAP_M[(np.abs(MAP_M[:, :2] - (101, 62)) < 20).all(axis=1)]
    site = Site.of_map(small_m)
    fix = site.localize(scan(MAP_M, POSES[1]), 0.95)
    away_m = np.linalg.norm(fix.world_T_sensor[:2, 3] - POSES[1][:2, 3])
    assert fix.accepted_at is None or away_m < 2


def test_a_map_in_one_tile_is_a_site() -> None:
    one_m = MAP_M[(MAP_M[:, :2] > 100.5).all(axis=1) & (MAP_M[:, :2] < 149.5).all(axis=1)]
    site = Site.of_map(one_m)
    assert site.targets.points_m(0).shape[1] == 3
    assert is_right(site, scan(one_m, planar(121, 129, 40)), planar(121, 129, 40))


def flat(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ground alone."""
    return points_m[points_m[:, 2] < 0.1]


REFUSED_POINTS: dict[str, tuple[Callable[[], NDArray[np.float64]], str]] = {
    "none": (lambda: np.empty((0, 3)), "without points"),
    "two columns": (lambda: MAP_M[:, :2], r"\(\d+, 2\): expected \(n, 3\)"),
    "NaN": (lambda: MAP_M[:9] * np.nan, "without points"),
    "ground alone": (lambda: flat(MAP_M), "nothing stands 1 m or more above its ground"),
    "strays": (lambda: MAP_M[::9000] * 100, "strays, fewer than 20 in each tile"),
    "too large": (
        lambda: np.concatenate([MAP_M, MAP_M + np.array([30_000, 30_000, 0])]),
        "its box is 30 × 30 km",
    ),
    "an object": (lambda: MAP_M[(MAP_M[:, :2] < 12).all(axis=1)], "as of an object"),
    "few": (lambda: MAP_M[:4000:180], "."),
}


@pytest.mark.parametrize("name", REFUSED_POINTS)
def test_points_that_are_no_map_are_refused(name: str) -> None:
    points, said = REFUSED_POINTS[name]
    with pytest.raises(InputError, match=said):
        Site.of_map(points())


@pytest.mark.parametrize(
    ("points_m", "axis"),
    [
        (MAP_M * [1, -1, -1], "−z"),
        (MAP_M[:, [0, 2, 1]] * [1, 1, -1], "y"),
        (MAP_M[:, [2, 0, 1]], "x"),
    ],
)
def test_a_map_in_other_axes_is_refused(points_m: NDArray[np.float64], axis: str) -> None:
    with pytest.raises(InputError, match=f"level if {axis} is upwards; expected z upwards"):
        Site.of_map(points_m)


@pytest.mark.parametrize("lift_m", [0.0, -1.8])
def test_a_single_scan_is_no_map(lift_m: float) -> None:
    with pytest.raises(InputError, match="as those of one scan"):
        Site.of_map(scan(MAP_M, POSES[0]) + np.array([0, 0, lift_m]))


def refused_files(folder: Path, name: str) -> Path:
    """The path of a map that is refused."""
    tiles = folder / "pointcloud_map"
    match name:
        case "empty":
            return write(folder / "town.pcd", np.empty((0, 3)))
        case "a tile missing":
            autoware.write_tiles(tiles, [MAP_M], 50)
            sorted(tiles.glob("*.pcd"))[3].unlink()
            return tiles
        case "millimetres":
            return write(folder / "town.pcd", MAP_M * 1000)
        case "a mesh":
            mesh = folder / "town.ply"
            mesh.write_text(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                "end_header\n0 0 0\n9 0 0\n0 9 3\n3 0 1 2\n"
            )
            return mesh
        case "2-D":
            return write(folder / "town.pcd", MAP_M * [1, 1, 0])
        case "x and y alone":
            text = "\n".join(f"{x:.2f} {y:.2f}" for x, y, _ in MAP_M[:2000].tolist())
            header = "VERSION .7\nFIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 2000\n"
            (folder / "town.pcd").write_text(f"{header}HEIGHT 1\nPOINTS 2000\nDATA ascii\n{text}\n")
            return folder / "town.pcd"
        case "NaN":
            return write(folder / "town.pcd", MAP_M[:5000] * np.nan)
        case "a scan":
            return write(folder / "000.pcd", scan(MAP_M, POSES[0]))
        case "y up":
            return write(folder / "town.pcd", MAP_M[:, [0, 2, 1]] * [1, 1, -1])
        case "upside down":
            return write(folder / "town.pcd", MAP_M * [1, -1, -1])
        case "no walls":
            return write(folder / "town.pcd", flat(MAP_M))
        case "few points":
            return write(folder / "town.pcd", MAP_M[:4000:180])
    return folder / name


REFUSED_FILES = {
    "empty": "holds no points",
    "a tile missing": "no tile .*which .* names",
    "millimetres": "if they are millimetres, divide them by 1000",
    "a mesh": "1 faces, a mesh",
    "2-D": "all points have the height 0",
    "x and y alone": "z",
    "NaN": "none of its 5000 points is finite",
    "a scan": "as those of one scan",
    "y up": "level if y is upwards",
    "upside down": "level if −z is upwards",
    "no walls": "a map without walls or trees cannot be searched",
    "few points": ".",
    "absent.pcd": "no such map",
}


@pytest.mark.parametrize("name", REFUSED_FILES)
def test_a_file_that_is_no_map_is_refused_in_one_line_and_leaves_no_site(
    yearloc: Command, tmp_path: Path, name: str
) -> None:
    out = tmp_path / "out" / "town.site"
    out.parent.mkdir()
    yearloc.capsys.readouterr()
    line = yearloc.refused("pack", "--map", refused_files(tmp_path, name), "-o", out)
    assert re.search(REFUSED_FILES[name], line), line
    assert "Traceback" not in line
    assert not list(out.parent.iterdir())


def test_pack_says_what_it_found_and_localize_uses_it(yearloc: Command, tmp_path: Path) -> None:
    write(tmp_path / "tiles" / "west.ply", MAP_M[MAP_M[:, 0] < 100])
    write(tmp_path / "east.pcd", MAP_M[MAP_M[:, 0] >= 100])
    like = write(tmp_path / "like.pcd", scan(MAP_M, POSES[3]))
    out = tmp_path / "town.site"
    said, _ = yearloc.run(
        *("pack", "--map", tmp_path / "tiles", "--map", tmp_path / "east.pcd", "-o", out),
        *("--like", like, "--cell", 0.5, "--origin", "100,100,0"),
    )
    assert "target precisions 0.9, 0.95, 0.97, 0.98, 0.985, 0.99 by the usual probabilities" in said
    assert Site.open(out).description.map.voxel_m == 0.5
    query = write(tmp_path / "0.pcd", scan(MAP_M, POSES[1]))
    answer, _ = yearloc.run("localize", out, query, "--json")
    fix = json.loads(answer)
    assert fix["verdict"] == "accepted"
    # (101, 63) in the map is (1, −37) from the origin.
    assert np.hypot(fix["x"] - 1, fix["y"] + 37) < 0.5
    assert abs(np.rad2deg(2 * np.arctan2(fix["qz"], fix["qw"])) % 360 - 130) < 1


def test_options_that_cannot_be_are_refused(yearloc: Command, tmp_path: Path) -> None:
    city = write(tmp_path / "town.pcd", MAP_M[:100])
    pack = ("pack", "--map", city, "-o", tmp_path / "town.site")
    assert "--cell 5: expected 0.1 to 1.0 metres" in yearloc.refused(*pack, "--cell", 5)
    assert "--cell nan: expected" in yearloc.refused(*pack, "--cell", "nan")
    assert "--origin 1,2: expected X,Y,Z" in yearloc.refused(*pack, "--origin", "1,2")
    assert "--origin a,b,c: expected X,Y,Z" in yearloc.refused(*pack, "--origin", "a,b,c")
    assert "--origin 1,inf,2: expected finite" in yearloc.refused(*pack, "--origin", "1,inf,2")
    eleven = [word for _ in range(11) for word in ("--like", city)]
    assert "--like: 11 scans; expected at most 10" in yearloc.refused(*pack, *eleven)
    absent = tmp_path / "absent.pcd"
    assert f"--like {absent}: no such scan" in yearloc.refused(*pack, "--like", absent)
    assert "no such scan" in yearloc.refused(*pack, "--like", tmp_path)
    hollow = write(tmp_path / "hollow.pcd", MAP_M[:9] * np.nan)
    assert "has no finite point" in yearloc.refused(*pack, "--like", hollow)
    study = ("pack", "campus/10m/sci", "-o", tmp_path / "x.site")
    assert "are for a 3-D map" in yearloc.refused(*study, "--cell", 0.4)
    assert not (tmp_path / "town.site").exists()
