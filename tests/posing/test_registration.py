"""Tests of registration: a known pose is found, and clouds that cannot be registered are
refused."""

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import distance_and_turn
from pipeline.posing.registration import Registration
from tests.posing.scene import planar, scene, seen_from


@pytest.mark.parametrize(("x_m", "y_m", "yaw_deg"), [(1.5, -1.0, 6.0), (-2.5, 0.5, 175.0)])
def test_a_known_pose_is_found(x_m: float, y_m: float, yaw_deg: float) -> None:
    target = scene()
    true = planar(x_m, y_m, yaw_deg)
    result = Registration().align(target, seen_from(scene(), true), true @ planar(1.0, 0.5, 4.0))
    away_m, turn_deg = distance_and_turn(result.target_T_source[None], true[None])
    assert away_m[0] < 0.05
    assert turn_deg[0] < 0.2
    assert result.overlap > 0.95
    assert result.covariance.shape == (6, 6)
    assert result.spread_m < 0.05


def test_other_houses_overlap_less() -> None:
    result = Registration().align(scene(0), scene(1), np.eye(4))
    same = Registration().align(scene(0), scene(0), np.eye(4))
    assert result.overlap < 0.75 * same.overlap


def test_a_bare_plane_and_a_bare_wall_leave_directions_open() -> None:
    rng = np.random.default_rng(0)
    plane = np.column_stack([rng.uniform(-20, 20, (5000, 2)), rng.normal(0, 0.03, 5000)])
    wall = np.column_stack(
        [rng.uniform(-20, 20, 5000), rng.normal(10, 0.03, 5000), rng.uniform(0, 8, 5000)]
    )
    assert Registration().align(plane, plane, np.eye(4)).spread_m == np.inf
    assert (
        Registration().align(np.r_[plane, wall], np.r_[plane, wall], np.eye(4)).spread_m == np.inf
    )
    assert Registration().align(scene(), scene(), np.eye(4)).spread_m < 0.01


def test_the_covariance_is_what_repeated_noise_gives() -> None:
    rng = np.random.default_rng(0)
    poses = []
    for _ in range(12):
        noisy = [scene() + rng.normal(0, 0.05, scene().shape) for _ in range(2)]
        result = Registration().align(*noisy, np.eye(4))
        poses.append(result.target_T_source[:3, 3])
    expected = np.sqrt(np.diag(result.covariance)[3:])
    assert (np.std(poses, axis=0) / expected < 4).all()
    assert (np.std(poses, axis=0) / expected > 0.25).all()


def test_residuals_of_one_wall_depend_on_one_another() -> None:
    """Things that are displaced as a whole count as few residuals, not as one for each point."""
    cubes, cube = np.unique(np.floor(scene() / 4), axis=0, return_inverse=True)
    displaced_m = np.random.default_rng(0).normal(0, 0.1, cubes.shape)
    result = Registration().align(scene(), scene() + displaced_m[cube.ravel()], np.eye(4))
    widened = np.diag(result.dependent_covariance) / np.diag(result.covariance)
    assert (widened > 2).all()


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((12, 3)), "12 points in 1 voxels of 0.5 m: registration needs 100"),
        (np.full((500, 3), np.nan), "expected finite points"),
        (np.zeros((500, 2)), r"points of shape \(500, 2\)"),
        (np.zeros((0, 3)), "0 points in 0 voxels"),
    ],
)
def test_what_cannot_be_registered_is_refused(points: np.ndarray, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Registration().align(points, scene(), np.eye(4))
    with pytest.raises(InputError, match=says):
        Registration().align(scene(), points, np.eye(4))


def test_a_guess_that_is_no_pose_is_refused() -> None:
    with pytest.raises(InputError, match=r"first guess of shape \(3, 3\)"):
        Registration().align(scene(), scene(), np.eye(3))
    with pytest.raises(InputError, match="expected a finite pose"):
        Registration().align(scene(), scene(), np.full((4, 4), np.nan))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"voxel_m": 0}, "registration.voxel_m=0"),
        ({"cell_m": 1.0}, "registration.cell_m=1.0: expected more than registration.reach_m=1.0"),
        ({"neighbours": 2}, "registration.neighbours=2: expected at least 5"),
    ],
)
def test_settings_are_checked(settings: dict[str, float], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        Registration(**settings)  # type: ignore[arg-type]
