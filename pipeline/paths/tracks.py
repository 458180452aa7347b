"""Tracks: the fixes of a drive in their order, to be joined with its odometry (METHODS 9.9)."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas
from pipeline.alterations import read_cases
from pipeline.errors import InputError
from pipeline.frames import Poses, turns, yaw
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.answers import lead
from pipeline.store import Artifact


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


def joined(
    fixes: Artifact, odom_T_anchor: Poses, path: Path, places: Places
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The columns and attributes of a fixes artifact, with estimates in place of the fixes.

    Each case is a drive. An estimate is accepted where its chance alone keeps what is wanted, for
    no held-out blocks tell more. Raises InputError where fixes and odometry (n, 4, 4) are not of
    the same submaps.
    """
    columns = {
        name: fixes.load(name)
        for name in [field.name for field in fields(Ranking) if field.name != "kinds"]
    }
    columns |= {
        name: fixes.load(name) for name in ("turned_deg", "world_T_query", "covariance", "overlap")
    }
    cases = len(read_cases(fixes.attrs))
    n = len(odom_T_anchor)
    attrs = fixes.attrs
    if len(columns["places"]) != n * cases:
        raise InputError(
            f"{fixes.path}: {len(columns['places'])} queries in {cases} cases of {n} submaps"
        )
    for case in range(cases):
        case_rows = slice(case * n, (case + 1) * n)
        odom_T_query = odom_T_anchor @ turns(
            np.deg2rad(columns["turned_deg"][case_rows].astype(np.float64))
        )
        novelty = columns["novelty"][case_rows].astype(np.float64)
        world_T_query = columns["world_T_query"][case_rows]
        accepted = novelty[:, 0] < attrs["promised"][1]
        estimates = path.along(
            Track(
                odom_T_query,
                world_T_query,
                1 - novelty[:, 0],
                accepted,
                columns["covariance"][case_rows],
            )
        )
        columns["world_T_query"][case_rows] = estimates.world_T_query
        columns["confidence"][case_rows] = estimates.chance
        columns["novelty"][case_rows, 0] = 1 - estimates.chance
        # the covariance is that of each query's own fix, which the estimate replaces
        columns["covariance"][case_rows] = np.nan
        for row in np.flatnonzero(np.isfinite(estimates.world_T_query).all((1, 2))).tolist():
            pose = estimates.world_T_query[None, row]
            xy_m = pose[:, :2, 3]
            first = {
                "places": places.at(xy_m),
                "costs": [0.0],
                "xy_m": xy_m,
                "heading_deg": np.rad2deg(yaw(pose)),
            }
            lead(columns, case * n + row, first)
    thresholds = [1 - attrs["wanted_precision"], *attrs["thresholds"][1:]]
    fix_attrs = {name: attrs[name] for name in schemas.FIXES.attrs}
    promised = {"promised": [1 - promise for promise in attrs["promises"]]}
    # place and several were judged of another pose
    accept_nothing = [ACCEPT_NOTHING] * len(attrs["promises"])
    return columns, fix_attrs | promised | {
        "thresholds": thresholds,
        "promised_place": accept_nothing,
        "promised_several": accept_nothing,
    }
