"""Tests of datums: positions on the Earth as metres in a site's world."""

import numpy as np
import pytest

from pipeline.core.datum import Datum
from pipeline.core.errors import ConfigError


@pytest.mark.parametrize(
    ("latitude_deg", "north_m", "east_m"), [(0.0, 110.574, 111.319), (60.0, 111.412, 55.800)]
)
def test_a_thousandth_of_a_degree_in_metres(
    latitude_deg: float, north_m: float, east_m: float
) -> None:
    """Along a meridian M = a (1 − e²) / w³ a radian, along a parallel N cos φ = a cos φ / w, with
    w² = 1 − e² sin² φ: at the equator 6,335,439 and 6,378,137 m; at 60° w² = .9949792, so
    6,383,454 and 3,197,105 m. A thousandth of a degree is 1.745329e-5 of them."""
    datum = Datum(latitude_deg, 10.0, 100.0)
    lla = np.array([[latitude_deg + 1e-3, 10.0, 100.0], [latitude_deg, 10.0 + 1e-3, 100.0]])
    north, east = datum.xyz_m(lla)
    # 100 m above the ellipsoid all is longer by 100 m in 6,378 km: 1.6e-5
    np.testing.assert_allclose(north[:2], (0.0, north_m * (1 + 1.6e-5)), atol=2e-3)
    np.testing.assert_allclose(east[:2], (east_m * (1 + 1.6e-5), 0.0), atol=2e-3)


def test_the_earth_curves_away_below_the_plane() -> None:
    """11.132 km east of the datum the sphere lies d² / 2a = 9.71 m below; 50 m higher is 50 m."""
    xyz_m = Datum(0.0, 0.0, 0.0).xyz_m(np.array([[0.0, 0.1, 0.0], [0.0, 0.0, 50.0]]))
    assert xyz_m[0, 2] == pytest.approx(-9.71, abs=0.01)
    np.testing.assert_allclose(xyz_m[1], (0, 0, 50), atol=1e-6)


def test_a_world_whose_x_axis_points_to_the_north() -> None:
    """90° counter-clockwise from east is north: x is north, and y is west."""
    datum = Datum(0.0, 0.0, 0.0, heading_deg=90.0)
    north, east = datum.xyz_m(np.array([[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0]]))
    np.testing.assert_allclose(north[:2], (110.574, 0), atol=2e-3)
    np.testing.assert_allclose(east[:2], (0, -111.319), atol=2e-3)


def test_a_datum_is_parsed_and_what_is_none_is_refused_in_a_line() -> None:
    assert Datum.parse("--datum", "42.3,-83.7,270") == Datum(42.3, -83.7, 270.0, 0.0)
    assert Datum.parse("--datum", "42.3,-83.7,270,90").heading_deg == 90
    for text in ("42.3,-83.7", "91,0,0", "0,181,0", "nan,0,0", "north,0,0", "1,2,3,4,5"):
        with pytest.raises(ConfigError, match=r"^--datum .*: expected LAT,LON,ALT or") as refused:
            Datum.parse("--datum", text)
        assert "\n" not in str(refused.value)
