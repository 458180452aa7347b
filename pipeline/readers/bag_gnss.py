"""Reads the positions of GNSS from bags: bags and a topic of NavSatFix in, their positions out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.datum import is_on_earth
from pipeline.core.frames import Stamps
from pipeline.formats.bag import NAV_SAT_FIX
from pipeline.formats.bag_file import BagFile
from pipeline.readers.bag_poses import message_stamps, read_messages

UNKNOWN = 0
"""NavSatFix's type of a covariance that the receiver does not know."""


@dataclass(frozen=True)
class GnssTrack:
    """The valid positions of one topic, in the order of their stamps."""

    stamps_ns: Stamps
    lla: NDArray[np.float64]
    """(n, 3) latitude and longitude in degrees, altitude in metres above the ellipsoid; NaN for an
    altitude that is unknown."""
    covariance_m2: NDArray[np.float64]
    """(n, 2, 2) of metres east and north; NaN where it is unknown."""


def read_gnss(files: Sequence[BagFile], topic: str) -> GnssTrack:
    """Read the positions of a topic of NavSatFix; those without a fix are left out.

    A position has a fix if its status is at least 0, and its latitude and longitude are those of a
    position.
    """
    messages, _ = read_messages(files, topic, (NAV_SAT_FIX,), _numbers)
    stamps_ns, _ = message_stamps(topic, [(each.stamp_ns, each.received_ns) for each in messages])
    numbers = np.array([each.content for each in messages], np.float64).reshape(-1, 9)
    lla = numbers[:, 1:4]
    has_fix = (numbers[:, 0] >= 0) & is_on_earth(lla[:, :2])
    order = np.flatnonzero(has_fix)[np.argsort(stamps_ns[has_fix], kind="stable")]
    covariance_m2 = numbers[:, 5:].reshape(-1, 2, 2)
    is_known = (numbers[:, 4] != UNKNOWN) & np.isfinite(covariance_m2).all(axis=(1, 2))
    covariance_m2 = np.where(is_known[:, None, None], covariance_m2, np.nan)
    return GnssTrack(stamps_ns[order], lla[order], covariance_m2[order])


def _numbers(message: Any, _: str) -> list[float]:
    """Status, position, type of covariance, and the covariance of east and north, row by row."""
    covariance = np.asarray(message.position_covariance, np.float64).reshape(3, 3)
    return [
        message.status.status,
        message.latitude,
        message.longitude,
        message.altitude,
        message.position_covariance_type,
        *covariance[:2, :2].ravel().tolist(),
    ]
