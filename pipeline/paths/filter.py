"""A filter over a drive: each query is answered from all fixes up to it, as a robot must (METHODS 9.9)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.frames import Poses
from pipeline.paths.belief import DRIFT, Belief
from pipeline.paths.tracks import Estimates, Track
from pipeline.posing.verdict import RIGHT_M

LEAST_CHANCE = 1e-6


@dataclass(frozen=True)
class Filter:
    """Forward Bayes (METHODS 10.2): the likelier of the query's own pose and the last answer carried on by odometry."""

    unseen_share: float
    """Of queries to expect where training never was; the robot starts there with this chance."""

    def along(self, track: Track, anchors_m: NDArray[np.float64]) -> Estimates:
        """Estimates that know nothing of what comes later; where odometry is interrupted all begins anew."""
        poses, chances = np.full_like(track.world_T_query, np.nan), np.zeros(len(track.chance))
        belief, carried, driven_m = Belief(anchors_m, self.unseen_share), None, 0.0
        for row, pose in enumerate(track.world_T_query):
            step = track.steps[row - 1] if row else np.eye(4)
            if np.isfinite(step).all():
                belief.move(step)
                carried, driven_m = None if carried is None else carried @ step, driven_m + float(np.linalg.norm(step[:3, 3]))
            else:
                belief, carried = Belief(anchors_m, self.unseen_share), None
            options: list[tuple[float, float, Poses]] = []
            if np.isfinite(pose).all():
                chance = float(np.clip(track.chance[row], LEAST_CHANCE, 1 - LEAST_CHANCE))
                options.append((belief.see(pose, chance), 0.0, pose))
            if carried is not None:
                options.append((belief.at(carried) * still_right(driven_m), driven_m, carried))
            if options:
                chances[row], driven_m, carried = max(options, key=lambda option: option[0])
                poses[row] = carried
        return Estimates(poses, chances)


def still_right(driven_m: float) -> float:
    """The chance that a pose carried so far by drifting odometry is still within RIGHT_M along the way that it drifts most."""
    return float(erf(RIGHT_M / (np.sqrt(2) * DRIFT * driven_m))) if driven_m > 0 else 1.0
