"""Datums: where a site's world lies on the Earth, so that positions of GNSS become its x, y, z.

The world is taken as the plane that touches the ellipsoid of WGS 84 at the datum. Positions go
through Earth-centred coordinates (ECEF) to metres east, north and up of the datum, and are then
turned by its heading. Source: NIMA TR8350.2, *World Geodetic System 1984*, 2000, 3.2 and 4.3.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError

RADIUS_M = 6_378_137.0
"""The ellipsoid's radius at the equator."""
FLATTENING = 1 / 298.257223563
"""How much shorter the ellipsoid's radius is at the poles, as a share."""
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
MOST_DEG = (90.0, 180.0)
"""Largest latitude and longitude."""


@dataclass(frozen=True)
class Datum:
    """The position on the Earth of a world's origin, and the direction of its x axis."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    """Above the ellipsoid, as NavSatFix has it."""
    heading_deg: float = 0.0
    """The direction of the world's x axis, counter-clockwise from east."""

    def __post_init__(self) -> None:
        """Raises ConfigError for numbers that are no position on the Earth."""
        numbers = (self.latitude_deg, self.longitude_deg, self.altitude_m, self.heading_deg)
        if not np.isfinite(numbers).all() or not is_on_earth(np.array(numbers[:2])):
            raise ConfigError(
                f"datum {self}: expected a latitude of −90 to 90°, a longitude of −180 to 180°, an "
                "altitude in metres and a heading in degrees"
            )

    def __str__(self) -> str:
        return (
            f"{self.latitude_deg:g},{self.longitude_deg:g},{self.altitude_m:g},{self.heading_deg:g}"
        )

    @classmethod
    def parse(cls, key: str, text: str) -> Self:
        """The datum in LAT,LON,ALT[,HEADING]; raises ConfigError, which names the option `key`."""
        try:
            numbers = [float(word) for word in text.split(",")]
            if len(numbers) not in (3, 4):
                raise ValueError
            return cls(*numbers)
        except (ValueError, ConfigError):
            raise ConfigError(
                f"{key} {text:.60}: expected LAT,LON,ALT or LAT,LON,ALT,HEADING: degrees, metres "
                "above the ellipsoid, and the world's x axis in degrees counter-clockwise from east"
            ) from None

    def xyz_m(self, lla: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (n, 3) in the world, of latitudes, longitudes and altitudes (n, 3).

        Angles are in degrees, lengths in metres.
        """
        origin = np.array([[self.latitude_deg, self.longitude_deg, self.altitude_m]])
        latitude, longitude = np.deg2rad(origin[0, :2])
        sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
        sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
        enu_R_ecef = np.array(
            [
                [-sin_lon, cos_lon, 0.0],
                [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
            ]
        )
        enu_m = (_ecef_m(lla) - _ecef_m(origin)) @ enu_R_ecef.T
        xyz_m = enu_m.copy()
        xyz_m[:, :2] = enu_m[:, :2] @ self.world_R_enu.T
        return np.asarray(xyz_m)

    @property
    def world_R_enu(self) -> NDArray[np.float64]:
        """(2, 2) turns directions east, north into directions along the world's x, y."""
        heading_rad = np.deg2rad(self.heading_deg)
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        return np.array([[cos, sin], [-sin, cos]])


def is_on_earth(lat_lon_deg: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which latitudes and longitudes (…, 2) in degrees are those of a position."""
    return np.asarray((np.abs(lat_lon_deg) <= MOST_DEG).all(axis=-1))


def _ecef_m(lla: NDArray[np.float64]) -> NDArray[np.float64]:
    """Earth-centred positions (n, 3) in metres of latitudes, longitudes and altitudes (n, 3)."""
    latitude, longitude = np.deg2rad(lla[:, :2]).T
    altitude_m = lla[:, 2]
    normal_m = RADIUS_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    across_m = (normal_m + altitude_m) * np.cos(latitude)
    along_m = (normal_m * (1 - ECCENTRICITY_SQUARED) + altitude_m) * np.sin(latitude)
    return np.column_stack([across_m * np.cos(longitude), across_m * np.sin(longitude), along_m])
