"""Odometry: the first accepted fix, carried on by odometry alone (METHODS 9.9).

It is the baseline of the filter and the graph.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.paths.belief import DRIFT, still_right
from pipeline.paths.tracks import Estimates, Track


@dataclass(frozen=True)
class Odometry:
    """Dead reckoning from an accepted fix on."""

    def along(self, track: Track) -> Estimates:
        """Carry the first accepted fix on by odometry; before it there is no estimate.

        After a break in odometry, the next accepted fix is carried on.
        """
        poses = np.full_like(track.world_T_query, np.nan)
        probabilities = np.zeros(len(track.probability))
        probability = 0.0
        driven_m = 0.0
        for row in range(len(poses)):
            # NaN before any fix, and at a break in odometry
            carried_pose = poses[row - 1] @ track.steps[row - 1] if row else poses[0]
            if np.isfinite(carried_pose).all():
                poses[row] = carried_pose
                driven_m = driven_m + float(np.linalg.norm(track.steps[row - 1][:3, 3]))
                probabilities[row] = probability * float(still_right(np.array(DRIFT * driven_m)))
            elif track.accepted[row]:
                poses[row] = track.world_T_query[row]
                driven_m = 0.0
                probability = float(track.probability[row])
                probabilities[row] = probability
        return Estimates(poses, probabilities, probabilities)
