"""Tracks: the fixes of a drive's queries in their order, joined with its odometry (METHODS 9.9).

The stage `paths` calls `joined`. In: the fixes of a test sequence and its odometry. Out: the same
artifact with other poses: a `Path` (filter, odometry or graph, each in its own file) estimates each
query's pose from the track. They are a further variant of the method.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import RIGHT_WITHIN, Poses, turns, yaw
from pipeline.core.schemas import Fixes
from pipeline.matching.places import Places
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.paths.belief import NEW_VIEW_M
from pipeline.perturbations import read_cases
from pipeline.posing.answers import put_first


@dataclass(frozen=True)
class Track:
    """The fixes of q queries along one drive."""

    odom_T_query: Poses
    """(q, 4, 4) poses by odometry; NaN where there is none."""
    world_T_query: Poses
    """(q, 4, 4) the fix of each query by itself; NaN if it has none."""
    probability: NDArray[np.float64]
    """(q,) the probability that the fix is right."""
    accepted: NDArray[np.bool_]
    """(q,) whether the fix is accepted at the target precision, .99."""
    covariance: NDArray[np.float64]
    """(q, 6, 6) covariance of the fix: of a small turn in radians, then of a step in metres, in the
    query's frame."""
    accepted_at: NDArray[np.float64]
    """(q,) the highest target precision at which the fix is accepted; 0 if there is none."""
    new_view_m: float = NEW_VIEW_M
    """A robot that has moved by less has the same view: the same scans, if scans are gathered."""
    right_within: tuple[float, float] = RIGHT_WITHIN
    """Metres and degrees within which a pose is right."""

    @cached_property
    def steps(self) -> Poses:
        """The pose (q − 1, 4, 4) of each query in the frame of the query before.

        It is NaN at a break in odometry.
        """
        return np.asarray(np.linalg.inv(self.odom_T_query[:-1]) @ self.odom_T_query[1:])


@dataclass(frozen=True)
class Estimates:
    """The poses of a drive's q queries by the whole track, and their probabilities."""

    world_T_query: Poses
    """(q, 4, 4) poses; NaN for a query without an estimate."""
    probability: NDArray[np.float64]
    """(q,) the probability that the pose is right."""
    most_precise: NDArray[np.float64]
    """(q,) the highest target precision at which the pose is accepted; 0 if it is rejected, however
    probable it is."""

    def accepted(self, target_precision: float) -> NDArray[np.bool_]:
        """Which estimates (q,) are accepted at a target precision."""
        return self.most_precise >= target_precision

    def novelty(self, target_precisions: Sequence[float]) -> NDArray[np.float32]:
        """One minus the probability (q,), moved so that it agrees with what is accepted.

        For each target precision, it is below one minus this just if the estimate is accepted.
        """
        novelty = (1 - self.probability).astype(np.float32)
        for target_precision in target_precisions:
            threshold = np.float32(1 - target_precision)
            # the next float32 on either side, whichever way the threshold itself is rounded
            accepted = self.accepted(target_precision)
            novelty[accepted] = novelty[accepted].clip(max=np.nextafter(threshold, np.float32(0)))
            novelty[~accepted] = novelty[~accepted].clip(min=np.nextafter(threshold, np.float32(1)))
        return novelty


class Path(Protocol):
    """A way to join fixes and odometry: a file in pipeline/paths, and one or more in conf/path."""

    def along(self, track: Track) -> Estimates:
        """Estimate the pose of each query of a track."""


def joined(
    fixes: Fixes,
    odom_T_anchor: Poses,
    path: Path,
    places: Places,
    new_view_m: float = NEW_VIEW_M,
) -> Fixes:
    """The fixes of one sequence, with estimates along its path in place of the single poses.

    The queries of each case (pipeline/perturbations) are one drive. An estimate may be accepted if
    its probability is at least the target precision, since no validation blocks give a better
    threshold. A robot that has moved by less than `new_view_m` has the same view.
    Raises InputError if fixes and odometry (n, 4, 4) are not of the same n submaps.
    """
    cases = len(read_cases(fixes.cases))
    n = len(odom_T_anchor)
    if len(fixes.places) != n * cases:
        raise InputError(
            f"{fixes.path}: {len(fixes.places)} queries in {cases} cases of {n} submaps"
        )
    world_T_query = fixes.world_T_query.copy()
    probability = fixes.confidence.copy()
    novelty = fixes.novelty.copy()
    for case in range(cases):
        rows = slice(case * n, (case + 1) * n)
        estimates = path.along(_track(fixes, rows, odom_T_anchor, new_view_m))
        world_T_query[rows] = estimates.world_T_query
        probability[rows] = estimates.probability
        novelty[rows, 0] = estimates.novelty(fixes.target_precisions)
    # the other two claims, place and several, were judged at the pose of the query's own fix
    accept_nothing = (ACCEPT_NOTHING,) * len(fixes.target_precisions)
    return replace(
        fixes,
        **_answers_with_poses_first(fixes, world_T_query, places),
        world_T_query=world_T_query,
        novelty=novelty,
        confidence=probability,
        # the covariance was that of the query's own fix, which the estimate replaces
        covariance=np.full_like(fixes.covariance, np.nan),
        thresholds=(1 - fixes.target_precision, *fixes.thresholds[1:]),
        pose_thresholds=tuple(1 - target_precision for target_precision in fixes.target_precisions),
        place_thresholds=accept_nothing,
        several_thresholds=accept_nothing,
    )


def _track(fixes: Fixes, rows: slice, odom_T_anchor: Poses, new_view_m: float) -> Track:
    """The track of one case, whose queries are `rows`; its odometry is turned like the queries."""
    turn_rad = np.deg2rad(fixes.turned_deg[rows].astype(np.float64))
    error_probability = fixes.novelty[rows, 0].astype(np.float64)
    accepted_at = np.zeros(len(error_probability))
    for target_precision, threshold in sorted(
        zip(fixes.target_precisions, fixes.pose_thresholds, strict=True)
    ):
        accepted_at[error_probability < threshold] = target_precision
    return Track(
        odom_T_anchor @ turns(turn_rad),
        fixes.world_T_query[rows],
        1 - error_probability,
        error_probability < fixes.reject_from(),
        fixes.covariance[rows],
        accepted_at,
        new_view_m,
        fixes.right_within,
    )


def _answers_with_poses_first(fixes: Fixes, world_T_query: Poses, places: Places) -> dict[str, Any]:
    """The ranked answers of all queries; a query with a pose (q, 4, 4) has its place first."""
    names = ("places", "costs", "xy_m", "heading_deg")
    answers = {name: getattr(fixes, name).copy() for name in names}
    for row in np.flatnonzero(np.isfinite(world_T_query).all((1, 2))).tolist():
        pose = world_T_query[None, row]
        xy_m = pose[:, :2, 3]
        first = {
            "places": places.at(xy_m),
            "costs": [0.0],
            "xy_m": xy_m,
            "heading_deg": np.rad2deg(yaw(pose)),
        }
        put_first(answers, row, first)
    return answers
