"""Views of altered queries: one of every submap in each case of an alteration (METHODS 2.8).

The alteration changes a submap's points, and the view is computed from the changed points. A
bird-view shows an octree of many scans: each scan is altered with its own random numbers, so an
earlier scan may fill what the newest one lacks, and leave walls of its own. Turned queries reuse
the unaltered map; only the pose is rotated.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import TURNED, Alteration, Case, generator
from pipeline.core.frames import Poses, Stamps, turns
from pipeline.core.schemas import Scans, Submaps
from pipeline.views.birdview import BirdView
from pipeline.views.draw import Drawing, View
from pipeline.views.mapped import MappedViews

Image = tuple[int, Case, NDArray[Any], float]
"""Row of the submap, case, image, and the robot's turn to the left in radians."""


class AlteredRows(NamedTuple):
    """The rows of one case, as pipeline.matching.ranking.Rows takes them."""

    images: NDArray[Any]
    """(submap, …)."""
    stamps_ns: Stamps
    world_T_anchor: Poses
    """Turned as the robot is."""


def altered(
    scans: Scans, submaps: Submaps, view: View, alteration: Alteration
) -> dict[Case, AlteredRows]:
    """Views of every submap in every case but the one as driven, all of them in memory."""
    stamps_ns = submaps.load("stamps_ns")
    world_T_anchor = submaps.load("world_T_anchor")
    images = dict[Case, NDArray[Any]]()
    left_rad = {case: np.zeros(len(stamps_ns)) for case in alteration.cases[1:]}
    draw = _from_maps if isinstance(view, BirdView) else _from_points
    for row, case, image, turn_rad in draw(scans, submaps, view, alteration):
        images.setdefault(case, np.empty((len(stamps_ns), *image.shape), image.dtype))[row] = image
        left_rad[case][row] = turn_rad
    return {
        case: AlteredRows(images[case], stamps_ns, world_T_anchor @ turns(left_rad[case]))
        for case in left_rad
    }


def _from_points(
    scans: Scans, submaps: Submaps, view: View, alteration: Alteration
) -> Iterator[Image]:
    """Draw each case from the submaps' points, which are gathered once for all cases."""
    stamps_ns = submaps.load("stamps_ns")
    for row, points in enumerate(Drawing(scans, submaps, view).points()):
        for case in alteration.cases[1:]:
            altered_points, left_rad = alteration.alter(
                case, points, generator(alteration, stamps_ns[row])
            )
            yield row, case, view(altered_points), left_rad


def _from_maps(
    scans: Scans, submaps: Submaps, view: BirdView, alteration: Alteration
) -> Iterator[Image]:
    """Draw each case from its own octree of all scans.

    Turned cases reuse the unaltered one, seen from a turned pose.
    """
    stamps_ns = scans.load("stamps_ns")
    anchors = submaps.load("scans")
    as_driven, *other_cases = alteration.cases
    turned = [case for case in other_cases if case.change == TURNED]
    worlds = ({as_driven: turned} if turned else {}) | {
        case: [case] for case in other_cases if case not in turned
    }
    for world, cases in worlds.items():

        def seen(scan: int, points: NDArray[Any], world: Case = world) -> NDArray[Any]:
            return alteration.alter(world, points, generator(alteration, stamps_ns[scan]))[0]

        for row, (points, grown, pose) in enumerate(MappedViews(scans, submaps, view, seen).maps()):
            for case in cases:
                rng = generator(alteration, stamps_ns[anchors[row]])
                left_rad = alteration.alter(case, points, rng)[1] if case in turned else 0.0
                yield (
                    row,
                    case,
                    view.draw(grown, pose @ turns(np.array([left_rad]))[0], row),
                    left_rad,
                )
