"""Pose graph: the poses that fit steps, fixes, loops and the ground best (METHODS 9.9, 12.3).

A `PoseGraph` consists of poses and of factors, each with its noise model. It is solved by the
method of Levenberg and Marquardt in gtsam (Dellaert and Kaess 2017). `Graph` (graph.py) builds one
from the fixes of a drive, pipeline/slam one from the loops of a drive without poses.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import needed
from pipeline.core.frames import Poses


def imported_gtsam() -> Any:
    """Import gtsam, which only pose graphs need; raises NotInstalledError if it is missing."""
    with needed("graph", "113 MB"):
        import gtsam
    return gtsam


class PoseGraph:
    """The poses of some keys (whole numbers), and the factors on them and between them.

    The noise of a factor (`deviations` or `robust`) is that of a small turn in radians, then of a
    step in metres, in the frame of the factor's last key.
    """

    def __init__(self, keys: NDArray[np.int64], world_T_key: Poses) -> None:
        """Start with k keys and a first guess (k, 4, 4) of their poses."""
        self._gtsam = imported_gtsam()
        self._keys = keys.tolist()
        self._factors = self._gtsam.NonlinearFactorGraph()
        self._values = self._gtsam.Values()
        for key, pose in zip(self._keys, world_T_key, strict=True):
            self._values.insert(key, self._gtsam.Pose3(pose))

    def deviations(self, sds: NDArray[np.float64]) -> Any:
        """The noise model of independent standard deviations (6,)."""
        return self._gtsam.noiseModel.Diagonal.Sigmas(sds)

    def robust(
        self, covariance: NDArray[np.float64], more_deg: float, more_m: float, outlier: float
    ) -> Any:
        """The noise model of a covariance (6, 6), with Cauchy's robust loss.

        The deviations `more_deg` and `more_m` are added to the covariance. A factor that is off by
        more than `outlier` deviations loses weight.
        """
        floor = np.diag(np.repeat([np.deg2rad(more_deg), more_m], 3) ** 2)
        gaussian = self._gtsam.noiseModel.Gaussian.Covariance(covariance + floor)
        cauchy = self._gtsam.noiseModel.mEstimator.Cauchy.Create(outlier)
        return self._gtsam.noiseModel.Robust.Create(cauchy, gaussian)

    def hold(self, key: int, world_T_key: Poses, noise: Any) -> None:
        """Add a prior on the pose (4, 4) of a key: a fix, or the fixed pose of the first key."""
        pose = self._gtsam.Pose3(world_T_key)
        self._factors.add(self._gtsam.PriorFactorPose3(key, pose, noise))

    def join(self, key: int, later: int, key_T_later: Poses, noise: Any) -> None:
        """Add the pose (4, 4) of a later key in the frame of another key: a step, or a loop."""
        pose = self._gtsam.Pose3(key_T_later)
        self._factors.add(self._gtsam.BetweenFactorPose3(key, later, pose, noise))

    def level(self, key: int, normal: NDArray[np.float64], deg: float) -> None:
        """Add that a normal (3,) in a key's frame points upwards, with a deviation in degrees."""
        noise = self._gtsam.noiseModel.Isotropic.Sigma(2, np.deg2rad(deg))
        upward = self._gtsam.Unit3(0.0, 0.0, 1.0)
        in_key = self._gtsam.Unit3(*normal)
        self._factors.add(self._gtsam.AttitudeFactorPose3(key, upward, noise, in_key))

    def solved(self) -> Poses:
        """The poses (k, 4, 4) that fit all factors best."""
        optimizer = self._gtsam.LevenbergMarquardtOptimizer(self._factors, self._values)
        self._values = optimizer.optimize()
        return np.array([self._values.atPose3(key).matrix() for key in self._keys])

    def covariances(self) -> NDArray[np.float64]:
        """The covariance (k, 6, 6) of each pose of the solution."""
        spread = self._gtsam.Marginals(self._factors, self._values)
        return np.array([spread.marginalCovariance(key) for key in self._keys])
