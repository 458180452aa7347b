"""Filter: the pose of each query from its own and all earlier fixes (METHODS 9.9)."""

from dataclasses import dataclass

import numpy as np

from pipeline.paths.belief import LEAST_PROBABILITY, Belief
from pipeline.paths.tracks import Estimates, Track


@dataclass(frozen=True)
class Filter:
    """Takes the likeliest pose of a `Belief`, as a robot does while it drives: the query's own fix,
    or an earlier fix carried on by odometry.

    Only the query's own fix may be accepted, so that the scan at hand agrees with the map there,
    and only as `Belief.most_precise` says.
    """

    def along(self, track: Track) -> Estimates:
        """Estimate each query from the fixes up to it; a break in odometry resets the belief."""
        poses = np.full_like(track.world_T_query, np.nan)
        probabilities = np.zeros(len(track.probability))
        most_precise = np.zeros(len(track.probability))
        belief = _belief(track)
        for row, fix in enumerate(track.world_T_query):
            if row and np.isfinite(track.steps[row - 1]).all():
                belief.move(track.steps[row - 1])
            else:
                belief = _belief(track)
            if np.isfinite(fix).all():
                probability = np.clip(
                    track.probability[row], LEAST_PROBABILITY, 1 - LEAST_PROBABILITY
                )
                accepted_at = float(track.accepted_at[row])
                belief.see(fix, float(probability), accepted_at=accepted_at)
            if best := belief.best():  # none before the first fix
                poses[row], probabilities[row] = best
                if np.array_equal(poses[row], fix):
                    most_precise[row] = belief.most_precise(float(probability), accepted_at)
        return Estimates(poses, probabilities, most_precise)


def _belief(track: Track) -> Belief:
    """The belief about a robot that may be anywhere."""
    return Belief(right_within=track.right_within, new_view_m=track.new_view_m)
