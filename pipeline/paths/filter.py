"""Filter: each query is answered from all fixes up to it, as a robot must (METHODS 9.9)."""

from dataclasses import dataclass

import numpy as np

from pipeline.paths.belief import Belief
from pipeline.paths.tracks import Estimates, Track

LEAST_CHANCE = 1e-6


@dataclass(frozen=True)
class Filter:
    """Takes the likeliest pose of a belief (METHODS 10.2): the query's own fix or an earlier one.

    An earlier fix is carried on by odometry.
    """

    def along(self, track: Track) -> Estimates:
        """Estimate each query from what came before it; where odometry breaks off, begin anew."""
        poses = np.full_like(track.world_T_query, np.nan)
        chances = np.zeros(len(track.chance))
        belief = Belief()
        for row, pose in enumerate(track.world_T_query):
            if row and np.isfinite(track.steps[row - 1]).all():
                belief.move(track.steps[row - 1])
            else:
                belief = Belief()
            if np.isfinite(pose).all():
                belief.see(pose, float(np.clip(track.chance[row], LEAST_CHANCE, 1 - LEAST_CHANCE)))
            if best := belief.best():
                poses[row], chances[row] = best
        return Estimates(poses, chances)
