"""Refines poses in a level map to less than a cell, and computes their covariances (METHODS 13.3).

Gauss-Newton moves a pose so that the query's hits come nearer to walls. The residual of a hit is
its distance d to the nearest wall, interpolated between cells. Welsch's weights exp(−d²/2σ²)
suppress hits far from any wall, the more so the smaller σ becomes.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import FARTHEST_M, Field, distance_at

SIGMAS_M = (0.4, 0.2, 0.1)
"""The values of σ of the weights, in their order."""
STEPS = 8
"""Largest number of steps for each σ."""
LONGEST_STEP_M = 0.3
SHORTEST_STEP_M = 1e-3
LEAST_TURN_RAD = 1e-4
"""A step is shortened to LONGEST_STEP_M. The iteration ends after a step shorter than both
SHORTEST_STEP_M and LEAST_TURN_RAD."""
DEPENDENT_HITS = 20.0
"""This many neighbouring hits count as one independent hit, since their errors are similar."""
RANGE_ERROR_M = 0.05
"""Standard deviation of a hit's distance from its wall."""
LEAST_INFORMATION = 1e-3
"""Added to the information of x, y and heading, so that unconstrained directions do not move."""


def refined(
    field: Field,
    points_m: NDArray[np.float64],
    poses: NDArray[np.float64],
    sigmas_m: tuple[float, ...] = SIGMAS_M,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Refine poses (k, 3) of hits (n, 2); returns the poses and their covariances (k, 3, 3).

    A pose is x, y in metres and heading in radians, in the grid of the field; hits are in metres in
    the query's own frame.
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
            information / (DEPENDENT_HITS * RANGE_ERROR_M**2) + np.eye(3) * LEAST_INFORMATION
        )
    return refined_poses, covariances


@njit(cache=True, nogil=True)
def refine_in(distance_m, cell_m, points_m, pose, sigmas_m, farthest_m):  # type: ignore[no-untyped-def]
    """Refine a pose (3,) of hits (n, 2) in place; returns its information (3, 3).

    The information, the inverse of the covariance, is that for hits with errors of 1 m.
    `distance_m` (row, col) is the distance from each cell of side `cell_m` to the nearest wall; a
    hit that is `farthest_m` or more from any wall does not count.
    """
    information = np.zeros((3, 3))
    for sigma_m in sigmas_m:
        for _ in range(STEPS):
            information[:] = 0.0
            gradient = np.zeros(3)
            # sum the normal equations over the hits
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
                slope_x /= cell_m  # now metres per metre
                slope_y /= cell_m
                turn = -slope_x * across_y + slope_y * across_x  # how the distance grows per radian
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
            # solve them, and step; the damping leaves an unconstrained direction as it was
            damped = information.copy()
            for axis in range(3):
                damped[axis, axis] += LEAST_INFORMATION
            step = np.linalg.solve(damped, gradient)
            step_m = np.hypot(step[0], step[1])
            if step_m > LONGEST_STEP_M:
                step *= LONGEST_STEP_M / step_m
            pose -= step
            if step_m < SHORTEST_STEP_M and abs(step[2]) < LEAST_TURN_RAD:
                break
    return information
