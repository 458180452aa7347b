"""Poses refined to less than a cell, with covariance: Gauss-Newton on distances to walls."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import FARTHEST_M, Field, distance_at

SIGMAS_M = (0.4, 0.2, 0.1)
"""Distances count by exp(−d²/2σ²), from wide to narrow (Welsch's weights)."""
STEPS = 8
INDEPENDENT = 20.0
"""So many neighbouring hits tell as much as one: their errors are alike."""
RANGE_ERROR_M = 0.05
LEAST_INFORMATION = 1e-3
"""Added to the information of each degree of freedom: what nothing holds stays where it was."""


def refined(
    field: Field,
    points_m: NDArray[np.float64],
    poses: NDArray[np.float64],
    sigmas_m: tuple[float, ...] = SIGMAS_M,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Refine poses (k, 3) of points (n, 2); returns them and their covariances (k, 3, 3).

    Poses are x, y in metres and heading in radians, in the grid of the field.
    """
    refined_poses = poses.copy()
    covariances = np.empty((len(poses), 3, 3))
    for number in range(len(poses)):
        information = refine_in(
            field.distance_m,
            field.cell_m,
            np.ascontiguousarray(points_m),
            refined_poses[number],
            np.array(sigmas_m),
            FARTHEST_M,
        )
        covariances[number] = np.linalg.inv(
            information / (INDEPENDENT * RANGE_ERROR_M**2) + np.eye(3) * LEAST_INFORMATION
        )
    return refined_poses, covariances


@njit(cache=True, nogil=True)
def refine_in(distance_m, cell_m, points_m, pose, sigmas_m, farthest_m):  # type: ignore[no-untyped-def]
    """Refine a pose (3,) in place; returns the information (3, 3) of unit errors.

    Distances (row, col) in metres are of cells of `cell_m`, as far as `farthest_m`.
    """
    information = np.zeros((3, 3))
    for sigma_m in sigmas_m:
        for _ in range(STEPS):
            information[:] = 0.0
            gradient = np.zeros(3)
            cos = np.cos(pose[2])
            sin = np.sin(pose[2])
            for point in range(len(points_m)):
                across_x = cos * points_m[point, 0] - sin * points_m[point, 1]
                across_y = sin * points_m[point, 0] + cos * points_m[point, 1]
                distance, slope_x, slope_y = distance_at(
                    distance_m,
                    (pose[0] + across_x) / cell_m,
                    (pose[1] + across_y) / cell_m,
                    farthest_m,
                )
                if distance >= farthest_m:
                    continue
                weight = np.exp(-(distance**2) / (2 * sigma_m**2))
                slope_x /= cell_m
                slope_y /= cell_m
                turn = -slope_x * across_y + slope_y * across_x
                information[0, 0] += weight * slope_x * slope_x
                information[0, 1] += weight * slope_x * slope_y
                information[0, 2] += weight * slope_x * turn
                information[1, 1] += weight * slope_y * slope_y
                information[1, 2] += weight * slope_y * turn
                information[2, 2] += weight * turn * turn
                gradient[0] += weight * slope_x * distance
                gradient[1] += weight * slope_y * distance
                gradient[2] += weight * turn * distance
            information[1, 0] = information[0, 1]
            information[2, 0] = information[0, 2]
            information[2, 1] = information[1, 2]
            held = information.copy()
            for axis in range(3):
                held[axis, axis] += LEAST_INFORMATION
            step = np.linalg.solve(held, gradient)
            long = np.hypot(step[0], step[1])
            if long > 0.3:
                step *= 0.3 / long
            pose -= step
            if long < 1e-3 and abs(step[2]) < 1e-4:
                break
    return information
