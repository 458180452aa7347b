"""Altered queries, drawn: what a method looks at of every submap in each case of an alteration (METHODS 2.8).

A submap's points are altered before anything is drawn of them, whatever the view makes of them then. Bird-views are drawn of a
map that remembers: its scans are altered one by one, each by its own draw, so what one of them lacks an earlier one may show, and
new walls of the scans before may still be about. A turned robot has the map of one that is not, and stands turned in it.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import TURNED, Alteration, Case
from pipeline.frames import Poses, Stamps, pose
from pipeline.store import Artifact
from pipeline.views.birdview import BirdView
from pipeline.views.draw import Drawing, View
from pipeline.views.mapped import Mapped

Image = tuple[int, Case, NDArray[Any], float]
"""Row of its submap, the case, what is drawn, and by how many radians the robot is turned to the left."""


class Drawn(NamedTuple):
    """The rows of one case, as pipeline.matching.ranking.Rows takes them."""

    images: NDArray[Any]
    """(submap, …)."""
    stamps_ns: Stamps
    world_T_anchor: Poses
    """Turned as the robot is."""


def altered(scans: Artifact, submaps: Artifact, view: View, alteration: Alteration) -> dict[Case, Drawn]:
    """Views of every submap in every case but the one as driven, all of them in memory."""
    stamps_ns, world_T_anchor = submaps.load("stamps_ns"), submaps.load("world_T_anchor")
    images = dict[Case, NDArray[Any]]()
    left_rad = {case: np.zeros(len(stamps_ns)) for case in alteration.cases[1:]}
    draw = _mapped if isinstance(view, BirdView) else _drawn
    for row, case, image, turn_rad in draw(scans, submaps, view, alteration):
        images.setdefault(case, np.empty((len(stamps_ns), *image.shape), image.dtype))[row] = image
        left_rad[case][row] = turn_rad
    return {case: Drawn(images[case], stamps_ns, world_T_anchor @ turns(left_rad[case])) for case in left_rad}


def turns(left_rad: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) of a robot that has turned to the left (n,) on its place."""
    still = np.zeros((len(left_rad), 3))
    return pose(still, np.column_stack([still[:, :2], left_rad]))


def _drawn(scans: Artifact, submaps: Artifact, view: View, alteration: Alteration) -> Iterator[Image]:
    """Each submap's points are gathered once, then altered and drawn in each case."""
    stamps_ns = submaps.load("stamps_ns")
    for row, points in enumerate(Drawing(scans, submaps, view).points()):
        for case in alteration.cases[1:]:
            left, left_rad = alteration.alter(case, points, _rng(alteration, stamps_ns[row]))
            yield row, case, view(left), left_rad


def _mapped(scans: Artifact, submaps: Artifact, view: BirdView, alteration: Alteration) -> Iterator[Image]:
    """Each case grows its own map of all scans, but a turn changes none: those cases stand in the one as driven."""
    stamps_ns, anchors = scans.load("stamps_ns"), submaps.load("scans")
    as_driven, *others = alteration.cases
    turned = [case for case in others if case.change == TURNED]
    worlds = ({as_driven: turned} if turned else {}) | {case: [case] for case in others if case not in turned}
    for world, cases in worlds.items():

        def seen(scan: int, points: NDArray[Any], world: Case = world) -> NDArray[Any]:
            return alteration.alter(world, points, _rng(alteration, stamps_ns[scan]))[0]

        for row, (points, grown, standing) in enumerate(Mapped(scans, submaps, view, seen).maps()):
            for case in cases:
                rng = _rng(alteration, stamps_ns[anchors[row]])
                left_rad = alteration.alter(case, points, rng)[1] if case in turned else 0.0
                yield row, case, view.draw(grown, standing @ turns(np.array([left_rad]))[0], row), left_rad


def _rng(alteration: Alteration, stamp_ns: np.int64) -> np.random.Generator:
    """Anew for each query and case: see pipeline.alterations."""
    return np.random.default_rng((alteration.seed, int(stamp_ns)))
