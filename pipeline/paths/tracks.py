"""Tracks: the fixes of a drive in their order, to be joined with its odometry (METHODS 9.9)."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import read_cases
from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, turns, yaw
from pipeline.core.schemas import Fixes
from pipeline.matching.places import Places
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.answers import lead


@dataclass(frozen=True)
class Track:
    """The fixes of q queries along one drive."""

    odom_T_query: Poses
    """(q, 4, 4) by odometry; NaN where there is none."""
    world_T_query: Poses
    """(q, 4, 4) by each query alone; NaN where it has no pose."""
    chance: NDArray[np.float64]
    """(q,) that this pose is right."""
    accepted: NDArray[np.bool_]
    """(q,) whether it keeps a promise of .99."""
    covariance: NDArray[np.float64]
    """(q, 6, 6) of a turn in radians and a step in metres, in the query's frame."""

    @cached_property
    def steps(self) -> Poses:
        """The pose (q − 1, 4, 4) of each query in the frame of the one before.

        NaN where the odometry is interrupted.
        """
        return np.asarray(np.linalg.inv(self.odom_T_query[:-1]) @ self.odom_T_query[1:])


@dataclass(frozen=True)
class Estimates:
    """The poses of a drive's queries by all that the drive shows, and their chances."""

    world_T_query: Poses
    """(q, 4, 4); NaN where nothing is known."""
    chance: NDArray[np.float64]
    """(q,) that the pose is within 2 m and 5°."""


class Path(Protocol):
    """A way to join fixes and odometry: one file in pipeline/paths, one or more in conf/path."""

    def along(self, track: Track) -> Estimates:
        """Estimates for each query of a track."""


def joined(fixes: Fixes, odom_T_anchor: Poses, path: Path, places: Places) -> Fixes:
    """The fixes of one sequence with estimates along its path in place of single poses.

    Each case is a drive. An estimate is accepted where its chance alone keeps what is wanted, for
    no held-out blocks tell more. Raises InputError where fixes and odometry (n, 4, 4) are not of
    the same submaps.
    """
    cases = len(read_cases(fixes.cases))
    n = len(odom_T_anchor)
    if len(fixes.places) != n * cases:
        raise InputError(
            f"{fixes.path}: {len(fixes.places)} queries in {cases} cases of {n} submaps"
        )
    answers = {
        name: getattr(fixes, name).copy() for name in ("places", "costs", "xy_m", "heading_deg")
    }
    world_T_query = fixes.world_T_query.copy()
    novelty = fixes.novelty.copy()
    confidence = fixes.confidence.copy()
    for case in range(cases):
        rows = slice(case * n, (case + 1) * n)
        turn_rad = np.deg2rad(fixes.turned_deg[rows].astype(np.float64))
        doubt = fixes.novelty[rows, 0].astype(np.float64)
        estimates = path.along(
            Track(
                odom_T_anchor @ turns(turn_rad),
                fixes.world_T_query[rows],
                1 - doubt,
                doubt < fixes.reject_from(),
                fixes.covariance[rows],
            )
        )
        world_T_query[rows] = estimates.world_T_query
        confidence[rows] = estimates.chance
        novelty[rows, 0] = 1 - estimates.chance
        for row in np.flatnonzero(np.isfinite(estimates.world_T_query).all((1, 2))).tolist():
            pose = estimates.world_T_query[None, row]
            xy_m = pose[:, :2, 3]
            first = {
                "places": places.at(xy_m),
                "costs": [0.0],
                "xy_m": xy_m,
                "heading_deg": np.rad2deg(yaw(pose)),
            }
            lead(answers, case * n + row, first)
    # place and several were judged of another pose
    accept_nothing = (ACCEPT_NOTHING,) * len(fixes.promises)
    return replace(
        fixes,
        **answers,
        world_T_query=world_T_query,
        novelty=novelty,
        confidence=confidence,
        # that of each query's own fix, which the estimate replaces
        covariance=np.full_like(fixes.covariance, np.nan),
        thresholds=(1 - fixes.wanted_precision, *fixes.thresholds[1:]),
        promised=tuple(1 - promise for promise in fixes.promises),
        promised_place=accept_nothing,
        promised_several=accept_nothing,
    )
