"""GNSS as a prior: the NavSatFix of a bag, and a site's datum."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.cli import main
from pipeline.core.datum import Datum
from pipeline.formats.bag import BagWriter
from pipeline.online import site_file
from pipeline.online.description import describe
from pipeline.online.gnss import widened
from pipeline.online.inputs import Scan, ScanOptions
from pipeline.online.localized import localized
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker
from pipeline.posing.prior import Prior
from tests.commands import Command
from tests.level.hall import map_of_hall
from tests.online.made import READER, packed, scan
from tests.readers.bags import START_NS, cloud

DATUM = {"latitude_deg": 0.0, "longitude_deg": 7.0, "altitude_m": 0.0, "heading_deg": 0.0}
SECOND_NS = 10**9
LATITUDE_M, LONGITUDE_M = 110_574.3, 111_319.5
"""Metres a degree at the equator."""


def at(x_m: float, y_m: float) -> tuple[float, float, float]:
    """Latitude, longitude and altitude of a position in the world."""
    return y_m / LATITUDE_M, 7 + x_m / LONGITUDE_M, float("nan")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five clouds of one place, 1 s apart; before each the positions that the tests speak of."""
    points_m, pose = scan()
    x_m, y_m = pose[:2, 3]
    path = tmp_path_factory.mktemp("bags") / "day"
    with BagWriter(path, "mcap") as writer:
        for second in range(5):
            cloud(writer, START_NS + second * SECOND_NS, "base_link", points_m)
        # 1: known to 3 m east and .1 m north; 4: 1.9 s later only what is no fix
        covariance_m2 = np.diag([9.0, 0.01, 25.0])
        writer.nav_sat_fix(START_NS + 9 * 10**8, "gps", at(x_m, y_m), covariance_m2)
        writer.nav_sat_fix(START_NS + 19 * 10**8, "gps", at(x_m + 3, y_m))
        writer.nav_sat_fix(START_NS + 29 * 10**8, "gps", at(999, 999), status=-1)
        writer.nav_sat_fix(START_NS + 39 * 10**8, "gps", (float("nan"), 7.0, 0.0))
    return path


def priors(bag: Path, **datum: float) -> list[Prior | None]:
    """The prior of each scan of the bag."""
    options = ScanOptions(READER, gnss="/fix", datum=Datum(**{**DATUM, **datum}))
    return [scan.prior for scan in options.scans(str(bag), Counter())]


def test_a_scan_has_the_last_valid_position_of_two_seconds_before_it(bag: Path) -> None:
    """At 0 s there is none. At 3 s that of 1.9 s is the last valid one; at 4 s it is 2.1 s old."""
    x_m, y_m = scan()[1][:2, 3]
    none, first, second, third, fourth = priors(bag)
    assert none is None
    assert fourth is None
    assert first is not None
    assert second is not None
    assert third is not None
    np.testing.assert_allclose(first.xy_m, (x_m, y_m), atol=0.02)
    np.testing.assert_allclose(second.xy_m, (x_m + 3, y_m), atol=0.02)
    np.testing.assert_array_equal(third.xy_m, second.xy_m)
    assert first.heading_rad is None


def test_a_prior_is_as_wide_as_the_receiver_says_and_at_least_two_metres(bag: Path) -> None:
    """3 m east, and .1 m north become 2 m; without a covariance it is 10 m. In a world with x to
    the north, x has the 2 m."""
    _, first, second, *_ = priors(bag)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(first.covariance, np.diag([9.0, 4.0]), atol=1e-9)
    np.testing.assert_allclose(second.covariance, np.diag([100.0, 100.0]))
    _, turned, *_ = priors(bag, heading_deg=90.0)
    assert turned is not None
    np.testing.assert_allclose(turned.covariance, np.diag([4.0, 9.0]), atol=1e-9)


def test_a_covariance_that_is_none_becomes_one() -> None:
    """A receiver sends 16 and −1 m²: the second is no variance."""
    np.testing.assert_allclose(widened(np.diag([16.0, -1.0])), np.diag([16.0, 4.0]))
    np.testing.assert_allclose(widened(np.full((2, 2), np.nan)), np.diag([100.0, 100.0]))


def test_a_bag_is_localised_with_its_gnss(bag: Path, tmp_path: Path, yearloc: Command) -> None:
    site = packed(tmp_path, datum=DATUM)
    rows, said = yearloc.run("localize", site, bag, "--gnss", "/fix", "--csv")
    assert rows.count(",accepted,") == 5
    assert "--gnss /fix: a prior for 3 of the scans" in said
    assert "latitude 0.0000000°, longitude 7.0000000°" in str(describe(site))


def test_gnss_is_refused_in_a_line_without_a_datum_a_topic_or_a_bag(
    three_places: Path, bag: Path, tmp_path: Path, yearloc: Command
) -> None:
    assert "--gnss /fix: three/10m/scan_context has no datum; pack" in yearloc.refused(
        "localize", three_places, bag, "--gnss", "/fix"
    )
    site = packed(tmp_path, datum=DATUM)
    assert "--gnss /gps: " in (refused := yearloc.refused("localize", site, bag, "--gnss", "/gps"))
    assert "day has the NavSatFix /fix" in refused
    np.save(tmp_path / "scan.npy", scan()[0])
    assert "scan.npy is no bag" in yearloc.refused(
        "localize", site, tmp_path / "scan.npy", "--gnss", "/fix"
    )


def test_a_tracked_robot_needs_no_gnss_until_it_is_lost(
    three_places: Path, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first scan has no position; it starts the track, so those of the others are not used.
    A tracker that stays lost takes them all."""
    given: list[bool] = []
    follow = Tracker.follow

    def noting(
        tracker: Tracker, scan: Scan, points_m: NDArray[Any], prior: Prior | None = None
    ) -> Fix:
        given.append(prior is not None)
        return follow(tracker, scan, points_m, prior)

    monkeypatch.setattr(Tracker, "follow", noting)
    options = ScanOptions(READER, gnss="/fix", datum=Datum(**DATUM))
    site = Site.open(three_places)
    for target_precision in (0.95, None):
        tracker = Tracker(site, target_precision)
        list(localized(options.scans(str(bag), Counter()), tracker, None, []))
    assert given == [*5 * [False], False, True, True, True, False]


def test_the_site_of_a_map_keeps_its_datum(tmp_path: Path) -> None:
    yaml = map_of_hall(tmp_path)
    words = ["pack", "--map", str(yaml), "-o", str(tmp_path / "hall.site")]
    main([*words, "--datum", "42.3,-83.7,270,90"])
    parts = site_file.read_either(tmp_path / "hall.site")
    assert parts.description.datum == Datum(42.3, -83.7, 270.0, 90.0)
    assert "x axis 90° counter-clockwise from east" in str(describe(tmp_path / "hall.site"))
