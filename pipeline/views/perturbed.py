"""Draws the views of perturbed queries (METHODS 2.8): for each case, one view of every submap.

A perturbation changes points before a view is drawn from them: it turns the robot, removes things
or adds walls. A case is one such change, made to every query.

- Most views are drawn from a submap's own points, which are perturbed first.
- A bird-view is drawn from an octree of many scans. Each scan is perturbed with its own random
  numbers, so an earlier scan may fill what the newest one lacks, and the walls that are added to it
  stay in the map. Turned queries reuse the unperturbed map; only the pose is rotated.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, Stamps, turns
from pipeline.core.schemas import Scans, Submaps
from pipeline.perturbations import TURNED, Case, Perturbation, generator
from pipeline.views.birdview import BirdView
from pipeline.views.draw import Drawing, View
from pipeline.views.mapped import MappedViews


class PerturbedImage(NamedTuple):
    """The view of one submap in one case."""

    row: int
    """Row of the submap."""
    case: Case
    image: NDArray[Any]
    left_rad: float
    """How far the robot is turned to the left."""


class PerturbedRows(NamedTuple):
    """The views of all submaps in one case, with the fields of `matching.ranking.Rows`."""

    images: NDArray[Any]
    """(submap, …)"""
    stamps_ns: Stamps
    """(submap,)"""
    world_T_anchor: Poses
    """(submap, 4, 4) turned as the robot is."""


def perturbed(
    scans: Scans, submaps: Submaps, view: View, perturbation: Perturbation
) -> dict[Case, PerturbedRows]:
    """Draw the views of every submap in every case, except the first, which is unperturbed.

    All of them are kept in memory.
    """
    stamps_ns = submaps.load("stamps_ns")
    world_T_anchor = submaps.load("world_T_anchor")
    if isinstance(view, BirdView):
        drawn = _from_maps(scans, submaps, view, perturbation)
    else:
        drawn = _from_points(scans, submaps, view, perturbation)
    # The array of a case is made with its first image, which has the shape.
    images = dict[Case, NDArray[Any]]()
    left_rad = {case: np.zeros(len(stamps_ns)) for case in perturbation.cases[1:]}
    for row, case, image, turn_rad in drawn:
        if case not in images:
            images[case] = np.empty((len(stamps_ns), *image.shape), image.dtype)
        images[case][row] = image
        left_rad[case][row] = turn_rad
    return {
        case: PerturbedRows(images[case], stamps_ns, world_T_anchor @ turns(left_rad[case]))
        for case in left_rad
    }


def _from_points(
    scans: Scans, submaps: Submaps, view: View, perturbation: Perturbation
) -> Iterator[PerturbedImage]:
    """Draw the cases from the submaps' own points, which are gathered once for all cases."""
    stamps_ns = submaps.load("stamps_ns")
    for row, points in enumerate(Drawing(scans, submaps, view).points()):
        for case in perturbation.cases[1:]:
            rng = generator(perturbation, stamps_ns[row])
            perturbed_points, left_rad = perturbation.perturb(case, points, rng)
            yield PerturbedImage(row, case, view(perturbed_points), left_rad)


def _from_maps(
    scans: Scans, submaps: Submaps, view: BirdView, perturbation: Perturbation
) -> Iterator[PerturbedImage]:
    """Draw the cases from octrees: one map of perturbed scans a case, one for all turned cases."""
    stamps_ns = scans.load("stamps_ns")
    anchors = submaps.load("scans")
    # Turned cases are drawn from the map of unperturbed scans, every other case from its own map.
    unperturbed, *changed_cases = perturbation.cases
    turned_cases = [case for case in changed_cases if case.change == TURNED]
    cases_drawn_from_map_of = {unperturbed: turned_cases} if turned_cases else {}
    for case in changed_cases:
        if case not in turned_cases:
            cases_drawn_from_map_of[case] = [case]

    def perturb(map_case: Case, scan: int, points: NDArray[Any]) -> NDArray[Any]:
        rng = generator(perturbation, stamps_ns[scan])
        perturbed_points, _ = perturbation.perturb(map_case, points, rng)
        return perturbed_points

    for map_case, cases in cases_drawn_from_map_of.items():
        maps = MappedViews(scans, submaps, view, partial(perturb, map_case)).maps()
        for row, (newest_points, octree_map, odom_T_robot) in enumerate(maps):
            for case in cases:
                left_rad = 0.0
                if case in turned_cases:
                    # Only the angle is used: the map is seen from a turned pose instead.
                    rng = generator(perturbation, stamps_ns[anchors[row]])
                    _, left_rad = perturbation.perturb(case, newest_points, rng)
                odom_T_turned = odom_T_robot @ turns(np.array([left_rad]))[0]
                image = view.draw(octree_map, odom_T_turned, number=row)
                yield PerturbedImage(row, case, image, left_rad)
