"""Filter: the pose of each query from its own and all earlier fixes (METHODS 9.9)."""

from dataclasses import dataclass

import numpy as np

from pipeline.paths.belief import LEAST_PROBABILITY, Belief
from pipeline.paths.tracks import Estimates, Track


@dataclass(frozen=True)
class Filter:
    """Takes the likeliest pose of a `Belief`, as a robot does while it drives: the query's own fix,
    or an earlier fix carried on by odometry."""

    def along(self, track: Track) -> Estimates:
        """Estimate each query from the fixes up to it; a break in odometry resets the belief."""
        poses = np.full_like(track.world_T_query, np.nan)
        probabilities = np.zeros(len(track.probability))
        belief = Belief()
        for row, fix in enumerate(track.world_T_query):
            if row and np.isfinite(track.steps[row - 1]).all():
                belief.move(track.steps[row - 1])
            else:
                belief = Belief()
            if np.isfinite(fix).all():
                probability = np.clip(
                    track.probability[row], LEAST_PROBABILITY, 1 - LEAST_PROBABILITY
                )
                belief.see(fix, float(probability))
            if best := belief.best():  # none before the first fix
                poses[row], probabilities[row] = best
        return Estimates(poses, probabilities)
