"""Dense worlds: their scans are about as full as recorded ones, and nothing stands on the road.

Sparse worlds are as they were before there was any lining.
"""

from dataclasses import replace
from datetime import date
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fullness import figures, stretched
from pipeline.readers.kitti import read_velodyne
from tests.worlds.helpers import preset, record, refused
from worlds.driving.day import simulate_day
from worlds.driving.lidar import hdl64
from worlds.layout.blocks import build_campus
from worlds.layout.campus import Campus
from worlds.layout.shapes import Kind, Records, Species
from worlds.simulation import Simulation

KITTI = {"points": 123205, ".3-5 m": 0.463, "50 m light": 0.131, "50 m lit": 0.237}
"""How full the recorded log 00 is (docs/notes/worlds.md)."""
BAND = 1 / 3
"""A simulated number may differ from the recorded one by this share of it."""
PRESENT = date(2012, 6, 15), date(2012, 10, 28)


@pytest.fixture(scope="module")
def street() -> Simulation:
    """A small suburb lined as a street."""
    return replace(preset("suburb_street"), blocks=2, route_m=240.0)


@pytest.fixture(scope="module")
def dense(small: Simulation) -> Campus:
    """The small campus, lined as a campus."""
    return build_campus(small.seed, small.blocks, small.routes().streets, "campus")


def test_a_street_is_about_as_full_as_a_recorded_one(street: Simulation):
    found = figures(stretched("street", street, 2, 8))
    for name, recorded in KITTI.items():
        assert found[name] == pytest.approx(recorded, rel=BAND), name


def test_a_sparse_street_is_not(street: Simulation):
    found = figures(stretched("sparse", replace(street, lining="sparse"), 2, 8))
    assert found["50 m light"] < KITTI["50 m light"] / 2


def test_the_car_drives_past_everything(street: Simulation):
    recorder = street.recorder("00")
    driven = recorder.drive.world_T_body[:, :2, 3]
    boxes = recorder.day.scene.boxes
    boxes = boxes[boxes["kind"] != Kind.GROUND]
    off_m = driven[:, None] - np.stack([boxes["x_m"], boxes["y_m"]], 1)
    ahead = off_m[..., 0] * boxes["cos_yaw"] + off_m[..., 1] * boxes["sin_yaw"]
    left = off_m[..., 1] * boxes["cos_yaw"] - off_m[..., 0] * boxes["sin_yaw"]
    gaps = np.stack(
        [np.abs(ahead) - boxes["half_length_m"], np.abs(left) - boxes["half_width_m"]]
    ).max(0)
    assert gaps.min() > 0.5
    trunks = recorder.day.scene.cylinders
    gaps_m = np.hypot(*(driven[:, None] - np.stack([trunks["x_m"], trunks["y_m"]], 1)).T)
    assert gaps_m.min() > 1.0


def test_clutter_comes_and_goes_and_houses_stay(dense: Campus):
    first, second = (
        simulate_day(3, dense, day, number).scene.boxes for number, day in enumerate(PRESENT)
    )
    assert len(things(first, Kind.CLUTTER)) > 20
    assert len(things(first, Kind.CLUTTER) & things(second, Kind.CLUTTER)) < len(
        things(first, Kind.CLUTTER)
    )
    for kind in (Kind.BUILDING, Kind.BORDER):
        assert things(first, kind)
        assert things(first, kind) == things(second, kind)


def test_the_same_day_has_the_same_clutter(dense: Campus):
    first, again = (simulate_day(3, dense, PRESENT[0], 0).scene.boxes for _ in "ab")
    assert np.array_equal(first, again)


def test_fences_are_half_open_all_year(dense: Campus):
    for number, day in enumerate(PRESENT):
        boxes = simulate_day(3, dense, day, number).scene.boxes
        pales = boxes[boxes["species"] == Species.PALES]
        thin_m = 2 * pales[pales["kind"] == Kind.BORDER]["half_width_m"]
        assert len(thin_m)
        assert np.exp(-5.0 * thin_m) == pytest.approx(0.61, abs=0.01)


def test_gardens_lie_above_the_road(small: Simulation, dense: Campus):
    flat = build_campus(small.seed, small.blocks, small.routes().streets).ground
    x_m, y_m = np.random.default_rng(0).uniform(-100, 100, (2, 500))
    rise_m = dense.ground.at(x_m, y_m) - flat.at(x_m, y_m)
    off_m = dense.streets.clearance_m(np.stack([x_m, y_m], 1))
    assert np.abs(rise_m[off_m < -3]).max(initial=0) < 0.05
    assert 0.2 < np.median(rise_m[off_m > 8]) < 0.8


def test_a_dense_campus_keeps_buildings_and_streets(small: Simulation, dense: Campus):
    sparse = build_campus(small.seed, small.blocks, small.routes().streets)
    buildings = [
        [thing for thing in campus.structures if thing.kind == Kind.BUILDING]
        for campus in (sparse, dense)
    ]
    assert buildings[0] == buildings[1]


def test_another_lining_is_refused(small: Simulation):
    with refused("lining"):
        replace(small, lining="forest")


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("suburb_demo", "3ba087bdd6f2ab7a"),
        ("campus_demo", "f44d414c2168885e"),
        ("campus_nclt", "9efc24cfaceef62b"),
    ],
)
def test_sparse_worlds_are_as_they_were(name: str, digest: str):
    """The shapes of a day in whole millimetres, as they were before there was any lining."""
    world = replace(preset(name), route_m=100.0)
    scene = world.recorder(list(world.sequences)[-1]).day.scene
    digests = sha256()
    for shapes in (scene.boxes, scene.cylinders, scene.crowns):
        for field in shapes.dtype.names or ():
            digests.update(millimetres(shapes[field]))
    digests.update(millimetres(scene.heights_m))
    assert digests.hexdigest()[:16] == digest


def test_the_scanner_has_the_recorded_ones_azimuths(street: Simulation, tmp_path: Path):
    recording = record(replace(street, route_m=40.0, step_m=20.0), "00", tmp_path)
    scan = next((tmp_path / "00" / "sequences" / "00" / "velodyne").iterdir())
    assert len(hdl64(street.azimuths).directions) == 128_000
    assert len(read_velodyne(scan)) > 80_000
    assert recording.scans == 2


def millimetres(values: np.ndarray) -> bytes:
    """The bytes of values in whole thousandths; infinite ones become very large."""
    return (1000 * values).clip(-1e15, 1e15).round().astype("<i8").tobytes()


def things(boxes: Records, kind: Kind) -> set[tuple[float, ...]]:
    """x, y and top of all boxes of a kind."""
    chosen = boxes[boxes["kind"] == kind]
    return set(zip(*(chosen[name].tolist() for name in ("x_m", "y_m", "top_m")), strict=True))
