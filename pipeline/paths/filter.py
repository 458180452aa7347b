"""Filter: the pose of each query by its own fix and all before it, as on a robot (METHODS 9.9)."""

from dataclasses import dataclass

import numpy as np

from pipeline.paths.belief import LEAST_PROBABILITY, Belief
from pipeline.paths.tracks import Estimates, Track


@dataclass(frozen=True)
class Filter:
    """Takes the likeliest pose of a `Belief`: the query's own fix, or an earlier one driven on."""

    def along(self, track: Track) -> Estimates:
        """Estimate each query from the fixes up to it; where odometry breaks off, starts again."""
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
