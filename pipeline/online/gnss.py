"""Priors of GNSS: the positions of a bag and a site's datum in, a prior of each scan out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.datum import Datum
from pipeline.posing.prior import Prior
from pipeline.readers.bag_gnss import GnssTrack

OLDEST_S = 2.0
"""A position that is older than this says nothing of a scan."""
LEAST_SIGMA_M = 2.0
"""The least standard deviation: among walls receivers report too small a covariance, and where the
antenna is on the robot is not known."""
UNKNOWN_SIGMA_M = 10.0
"""The standard deviation of a position whose covariance is unknown."""


@dataclass(frozen=True)
class GnssPriors:
    """Where GNSS says that a robot is, in the world of a site."""

    track: GnssTrack
    datum: Datum

    def at(self, stamp_ns: int | None) -> Prior | None:
        """The prior of the last position up to a stamp; None if that is too old or unknown."""
        if stamp_ns is None:
            return None
        row = int(np.searchsorted(self.track.stamps_ns, stamp_ns, side="right")) - 1
        if row < 0 or stamp_ns - int(self.track.stamps_ns[row]) > 1e9 * OLDEST_S:
            return None
        lla = self.track.lla[row].copy()
        if not np.isfinite(lla[2]):
            lla[2] = self.datum.altitude_m  # x and y hardly depend on it
        pose = np.eye(4)
        pose[:2, 3] = self.datum.xyz_m(lla[None])[0, :2]
        world_R_enu = self.datum.world_R_enu
        covariance_m2 = widened(self.track.covariance_m2[row])
        return Prior(pose, world_R_enu @ covariance_m2 @ world_R_enu.T)


def widened(covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance (2, 2) with no standard deviation below LEAST_SIGMA_M.

    One that is NaN becomes that of UNKNOWN_SIGMA_M.
    """
    if not np.isfinite(covariance_m2).all():
        return UNKNOWN_SIGMA_M**2 * np.eye(2)
    values, vectors = np.linalg.eigh((covariance_m2 + covariance_m2.T) / 2)
    return np.asarray(vectors * values.clip(LEAST_SIGMA_M**2, None) @ vectors.T)
