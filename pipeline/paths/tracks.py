"""Tracks: the fixes of a drive in their order, and what they tell of each query together with the
odometry (METHODS 9.9)."""

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
        """(q − 1, 4, 4) each query in the frame of the one before; NaN where the odometry is
        interrupted."""
        return np.asarray(np.linalg.inv(self.odom_T_query[:-1]) @ self.odom_T_query[1:])


@dataclass(frozen=True)
class Estimates:
    """What a drive tells of its queries."""

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
    """The columns and attributes of a fixes artifact with the estimates along the path in place of
    the fixes.

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
        own = slice(case * n, (case + 1) * n)
        odom_T_query = odom_T_anchor @ turns(
            np.deg2rad(columns["turned_deg"][own].astype(np.float64))
        )
        novelty = columns["novelty"][own].astype(np.float64)
        world_T_query = columns["world_T_query"][own]
        accepted = novelty[:, 0] < attrs["promised"][1]
        found = path.along(
            Track(
                odom_T_query, world_T_query, 1 - novelty[:, 0], accepted, columns["covariance"][own]
            )
        )
        columns["world_T_query"][own] = found.world_T_query
        columns["confidence"][own] = found.chance
        columns["novelty"][own, 0] = 1 - found.chance
        columns["covariance"][own] = (
            np.nan
        )  # that of each query's own fix, which is not what answers now
        for row in np.flatnonzero(np.isfinite(found.world_T_query).all((1, 2))).tolist():
            pose = found.world_T_query[None, row]
            xy_m = pose[:, :2, 3]
            first = {
                "places": places.at(xy_m),
                "costs": [0.0],
                "xy_m": xy_m,
                "heading_deg": np.rad2deg(yaw(pose)),
            }
            lead(columns, case * n + row, first)
    thresholds = [1 - attrs["wanted_precision"], *attrs["thresholds"][1:]]
    kept = {name: attrs[name] for name in schemas.FIXES.attrs}
    promised = {"promised": [1 - promise for promise in attrs["promises"]]}
    nothing = [ACCEPT_NOTHING] * len(
        attrs["promises"]
    )  # place and several were judged of another pose
    return columns, kept | promised | {
        "thresholds": thresholds,
        "promised_place": nothing,
        "promised_several": nothing,
    }
