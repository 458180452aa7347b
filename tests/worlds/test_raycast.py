"""The ray caster, against trigonometry and a brute-force caster in numpy."""

from datetime import date

import numpy as np
import pytest

from tests.worlds import reference
from worlds.driving.day import simulate_day
from worlds.driving.lidar import hdl32
from worlds.driving.raycast import cast
from worlds.driving.scene import build_scene
from worlds.layout.campus import Campus
from worlds.layout.ground import Ground
from worlds.layout.plan import Plan
from worlds.layout.shapes import BOX, CROWN, CYLINDER, Kind, records

NOTHING = np.zeros(0, CYLINDER)
SEED = np.uint64(5)


def test_level_ground_is_met_where_trigonometry_says():
    # 1.3 m up, 30° down: 1.3 / sin 30° = 2.6 m; the cosine to the normal is sin 30° = 0.5, times
    # reflectance 0.2.
    flat = Ground(np.zeros((20, 20)), -80.0, -80.0)
    scene = build_scene(np.zeros(0, BOX), NOTHING, np.zeros(0, CROWN), flat)
    rays = np.array([[np.cos(np.pi / 6), 0.0, -0.5], [1.0, 0.0, 0.0]])
    ranges, kinds, brightness = cast(
        scene, NOTHING, np.array([[0.0, 0.0, 1.3]]), np.eye(3)[None], rays, 90.0, SEED
    )
    assert ranges == pytest.approx([2.6, 0.0])
    assert kinds.tolist() == [Kind.GROUND, Kind.NOTHING]
    assert brightness[0] == pytest.approx(0.1)


def test_a_mover_hides_what_is_behind_it():
    flat = Ground(np.zeros((20, 20)), -80.0, -80.0)
    wall = records(
        BOX,
        x_m=20.0,
        half_length_m=1.0,
        half_width_m=9.0,
        cos_yaw=1.0,
        top_m=5.0,
        kind=Kind.BUILDING,
    )
    person = records(CYLINDER, x_m=5.0, y_m=0.0, radius_m=0.25, top_m=1.8, kind=Kind.PERSON)
    scene = build_scene(wall, NOTHING, np.zeros(0, CROWN), flat)
    # The person's side is at 5 − 0.25, the wall's at 20 − 1.
    origin = np.array([[0.0, 0.0, 1.3]])
    ray = np.array([[1.0, 0.0, 0.0]])
    for movers, expected in ((person, (4.75, Kind.PERSON)), (NOTHING, (19.0, Kind.BUILDING))):
        ranges, kinds, _ = cast(scene, movers, origin, np.eye(3)[None], ray, 90.0, SEED)
        assert (ranges[0], kinds[0]) == expected


def test_the_grid_walk_sees_what_brute_force_sees(campus_and_plan: tuple[Campus, Plan]):
    campus, plan = campus_and_plan
    day = simulate_day(8, campus, date(2012, 6, 15), 152)
    rng = np.random.default_rng(0)
    rays = hdl32(40).directions
    solid = []
    leaves = []
    ground = []
    for leg in rng.integers(len(plan.line_m) - 1, size=8):
        place = plan.line_m[leg] + rng.random() * (plan.line_m[leg + 1] - plan.line_m[leg])
        origin = np.array([*place, day.ground.at(*place[:, None])[0] + 1.3])
        movers = day.movers(float(leg), place, 0.3)
        ranges, kinds, _ = cast(day.scene, movers, origin[None], np.eye(3)[None], rays, 90.0, SEED)
        expected, expected_kinds = reference.cast(day.scene, movers, origin, rays, 90.0, SEED)
        agrees = (np.abs(ranges - expected) < 0.01) & (kinds == expected_kinds)
        ground.append(agrees[np.isin(expected_kinds, [Kind.GROUND, Kind.NOTHING])])
        leaves.append(agrees[expected_kinds == Kind.LEAF])
        solid.append(agrees[~np.isin(expected_kinds, [Kind.GROUND, Kind.NOTHING, Kind.LEAF])])
    assert np.concatenate(solid).all()
    assert np.concatenate(leaves).mean() >= 0.99
    assert np.concatenate(ground).mean() >= 0.999
    assert min(len(np.concatenate(part)) for part in (solid, leaves, ground)) > 100
