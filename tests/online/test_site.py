"""A site localises scans, and a file that is no whole site is refused with the reason."""

import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.frames import distance_and_turn
from pipeline.online.description import describe
from pipeline.online.site import Site
from pipeline.online.site_file import ABOUT, MAP, MODEL
from pipeline.online.tracking import Tracker
from pipeline.posing.fix import ScanFix as Registered
from tests.online.made import SENSOR, about, packed, scan, with_content
from tests.posing.scene import hypothesis, scene
from tests.readers.damage import damaged, one_line


@pytest.fixture(scope="module")
def three(three_places: Path) -> Site:
    return Site.open(three_places)


@pytest.mark.parametrize("row", range(3))
def test_a_scan_is_localised(three: Site, row: int) -> None:
    points_m, world_T_robot = scan(row)
    fix = three.localize(points_m)
    away_m, turn_deg = distance_and_turn(fix.world_T_sensor[None], world_T_robot[None])
    assert (fix.verdict, fix.accepted_at) == ("accepted", 0.99)
    assert away_m[0] < 0.1
    assert turn_deg[0] < 0.3
    assert fix.place == three.places.at(world_T_robot[None, :2, 3])[0]
    assert fix.overlap > 0.8
    assert fix.ms > 0
    for other in fix.runners_up:
        assert np.linalg.norm(other.world_T_sensor[:2, 3] - fix.world_T_sensor[:2, 3]) >= 5


def test_another_place_is_rejected_and_too_few_points_have_no_pose(three: Site) -> None:
    assert three.localize(scene(7)).verdict == "rejected"
    of_few_points = three.localize(np.ones((5, 3)))
    assert of_few_points.verdict == "no pose"
    assert of_few_points.place == -1
    assert of_few_points.accepted_at is None
    assert np.isnan(of_few_points.world_T_sensor).all()


@pytest.mark.parametrize(
    ("overlaps", "verdict"),
    [
        ((0.8,), "accepted"),
        ((0.5,), "near"),
        ((0.75, 0.75), "ambiguous"),
        ((0.3,), "rejected"),
        ((), "no pose"),
    ],
)
def test_the_verdict_is_the_first_claim_that_is_accepted(
    three: Site, overlaps: tuple[float, ...], verdict: str
) -> None:
    """A pose with odds of e⁴ to 1 is accepted. At e⁻² it is not, but the robot is near it.

    Of two poses with e³, 200 m apart, one is right.
    """
    hypotheses = [hypothesis(200 * row, overlap) for row, overlap in enumerate(overlaps)]
    found = Registered.of(hypotheses, three.claim_judge.pose)
    fix = three.judge(found, 0.99)
    assert fix.verdict == verdict
    assert three.judge(found, None).verdict in ("rejected", "no pose")
    probabilities = [np.exp(3) / (1 + 2 * np.exp(3))] * (len(overlaps) - 1)
    assert [other.probability for other in fix.runners_up] == pytest.approx(probabilities)


def test_points_that_are_not_finite_are_dropped(three: Site) -> None:
    points_m, _ = scan()
    bad = np.concatenate([points_m, np.full((9, 3), np.nan), np.full((9, 3), 1e30)])
    fixes = [three.localize(points) for points in (bad, points_m)]
    np.testing.assert_array_equal(*(fix.world_T_sensor for fix in fixes))


@pytest.mark.parametrize(
    "points_m",
    [np.zeros(3), np.zeros((4, 2)), np.array([["a", "b", "c"]]), np.zeros((2, 3), complex)],
)
def test_an_array_that_is_no_cloud_is_refused(three: Site, points_m: Any) -> None:
    with one_line(InputError, r"expected numbers \(n, 3\), in metres"):
        three.localize(points_m)


def test_asked_for_more_than_it_keeps_a_site_keeps_what_it_can(three: Site) -> None:
    """The site file names its own target precisions, as those of earlier versions do: .99 is the
    most that it keeps."""
    points_m, _ = scan()
    for wanted, kept in ((0.999, 0.99), (0.99, 0.99), (0.975, 0.99), (0.5, 0.95)):
        for fix in (three.localize(points_m, wanted), Tracker(three, wanted).localize(points_m)):
            assert (fix.verdict, fix.target_precision) == ("accepted", kept)
    assert three.localize(np.zeros((0, 3)), 0.999).target_precision == 0.99  # no pose
    unaccepted = three.localize(points_m, target_precision=None)
    assert (unaccepted.verdict, unaccepted.target_precision) == ("rejected", None)


def test_a_strict_caller_is_refused_a_target_precision_without_a_threshold(three: Site) -> None:
    with one_line(
        InputError,
        "target_precision=0.5: this site has no threshold for it; it has thresholds for 0.95, 0.99",
    ):
        three.localize(scan()[0], target_precision=0.5, strict=True)
    with one_line(InputError, "target_precision=0.999: this site has no threshold for it"):
        Tracker(three, target_precision=0.999, strict=True)
    assert three.localize(scan()[0], 0.95, strict=True).target_precision == 0.95


def test_a_target_precision_that_is_no_share_is_refused(three: Site) -> None:
    for no_share in (99, -0.9):
        with one_line(InputError, "expected a share above 0 and at most 1, such as 0.99"):
            three.localize(scan()[0], target_precision=no_share)


def test_the_same_site_has_the_same_bytes(three_places: Path, tmp_path: Path) -> None:
    assert packed(tmp_path).read_bytes() == three_places.read_bytes()


def test_a_missing_site_is_refused_with_the_command_that_writes_one(tmp_path: Path) -> None:
    with one_line(ArtifactError, "campus.site: no such site; `yearloc pack"):
        Site.open(tmp_path / "campus.site")
    with one_line(ArtifactError, "a folder"):
        Site.open(tmp_path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"../evil": b""}, "it holds '../evil'"),
        ({ABOUT: b"{}"}, "it lacks a part"),
        ({ABOUT: b"{}", MODEL: b"", MAP: b""}, "no whole site"),
        ({ABOUT: b"\xff", MODEL: b"", MAP: b""}, "no whole site"),
    ],
    ids=["climbs out", "lacks", "no arrays", "no text"],
)
def test_a_zip_of_something_else_is_refused(
    tmp_path: Path, content: dict[str, bytes], says: str
) -> None:
    with zipfile.ZipFile(tmp_path / "a.site", "w") as file:
        for name, data in content.items():
            file.writestr(name, data)
    with one_line(ArtifactError, says):
        Site.open(tmp_path / "a.site")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"version": 1}, "a site of version 1, this yearloc reads version 6"),
        ({"method": {"_target_": "os.system"}}, "os.system: expected a class of pipeline.methods"),
        ({"view": {"_target_": "pipeline.views.draw.View"}}, "expected a class of"),
        ({"method": about()["method"] | {"candidates": "many"}}, "method.candidates=many"),
        ({"k": None}, "site.json: not given: k; pack the site again"),
        ({"verdict": {}}, "site.json: not given: verdict.pose, verdict.place"),
        ({"map": {"grain_m": 1}}, "site.json: not given: map.range_m, map.single; pack"),
        ({"simulated": 1}, "simulated=1: expected true or false"),
        ({"sensor": SENSOR | {"warnings": "z"}}, "sensor.warnings=z: expected a list"),
        ({"sensor": SENSOR | {"warnings": [], "lift_m": True}}, "lift_m=True: expected a number"),
        (
            {"places": {"cell_m": 10.0, "x_m": [5.0, -5.0], "y_m": [0.0, 1.0]}},
            "places: x_m=5.0…-5.0: the box must have a length",
        ),
        (
            {
                "incremental_learning": {
                    "voxel_m": 0.1,
                    "days": [{"day": "monday", "views": "many"}],
                }
            },
            r"incremental_learning.days\[0\].views=many: expected a whole number",
        ),
    ],
)
def test_the_content_of_site_json_is_checked(
    tmp_path: Path, changes: dict[str, Any], says: str
) -> None:
    with one_line(ArtifactError, says):
        Site.open(packed(tmp_path, **changes))


def test_a_key_that_is_missing_is_named(tmp_path: Path) -> None:
    content = about()
    del content["sensor"]
    with one_line(ArtifactError, "site.json: not given: sensor"):
        Site.open(with_content(tmp_path / "a.site", content))


@given(st.data())
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_site_is_opened_as_it_was_or_refused(
    three_places: Path, tmp_path: Path, data: Any
) -> None:
    broken = tmp_path / "broken.site"
    broken.write_bytes(data.draw(damaged(three_places.read_bytes())))
    with suppress(ArtifactError):
        Site.open(broken)


def test_a_description_says_what_a_site_holds_and_target_precisions(three_places: Path) -> None:
    text = describe(three_places).text()
    assert "site three/10m/scan_context, simulated" in text
    assert "3 cells of 10 m" in text
    assert "fixes with a novelty below 0.1" in text
    assert "cannot be reached" in text  # .999
