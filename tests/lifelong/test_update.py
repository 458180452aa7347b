"""`yearloc update`: a site learns new places from reference poses, and changes by itself.

The updated site is written whole or not at all.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.core import replacing
from pipeline.core.progress import Progress
from pipeline.lifelong.pseudo_labels import NoPseudoLabelsError, PseudoLabels, from_site
from pipeline.lifelong.steps import self_trained
from pipeline.lifelong.strategies import SelfTrained
from pipeline.lifelong.update import Update, planned, updated_map
from pipeline.matching.ranking import Rows
from pipeline.online import site_file
from pipeline.online.description import describe
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.pack import learned_from
from pipeline.online.site import Site
from pipeline.posing.verdict import CLAIMS
from pipeline.views.scan_context import ScanContext
from tests.online.made import ANCHORS, arrays, described, packed
from tests.posing.scene import planar, scene, seen_from

FOURTH = planar(600, 0, 20)
START_S = 1_326_652_795


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of three places, with what it was learned from."""
    model, mapped = arrays()
    views = Rows(np.stack([ScanContext()(scene(seed)) for seed in range(3)]), np.arange(3), ANCHORS)
    incremental_learning = {"voxel_m": 0.25, "days": [{"day": "monday", "views": 3}]}
    path = tmp_path_factory.mktemp("site") / "three.site"
    site_file.write(
        path,
        site_file.Parts(
            described(incremental_learning=incremental_learning),
            model,
            mapped,
            None,
            learned_from(views, model),
        ),
    )
    return path


def drive(folder: Path, clouds: dict[float, np.ndarray]) -> str:
    """A folder of scans at so many metres along x, named by their stamp in µs: a second a metre."""
    folder.mkdir()
    for x_m, points_m in clouds.items():
        np.save(
            folder / f"{int(1e6 * (START_S + x_m))}.npy",
            seen_from(points_m, planar(x_m, 0, 0)).astype(np.float32),
        )
    return str(folder)


def reference(path: Path, world_T_start: np.ndarray, xs_m: list[float]) -> str:
    """A TUM file with the poses of such a drive, which begins at the pose `world_T_start`."""
    poses = [(START_S + x_m, world_T_start @ planar(x_m, 0, 0)) for x_m in xs_m]
    half = np.deg2rad(10)
    path.write_text(
        "".join(
            f"{t:.6f} {p[0, 3]} {p[1, 3]} 0 0 0 {np.sin(half)} {np.cos(half)}\n" for t, p in poses
        )
    )
    return str(path)


def test_a_day_with_reference_poses_adds_a_place_and_the_old_ones_stay(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xs_m = [0.0, 1.0, 2.0]
    cloud = scene(5)
    log = drive(tmp_path / "tuesday", dict.fromkeys(xs_m, cloud))
    poses = reference(tmp_path / "poses.txt", FOURTH, xs_m)
    main(["update", str(site), log, "--poses", poses, "-o", str(tmp_path / "four.site")])
    reported = capsys.readouterr().out
    assert (
        "3 of 3 scans with reference poses; 1 new places beside 3; 0 submaps have changed"
        in reported
    )
    assert "4 places" in reported
    assert (
        "its thresholds come from 100 validation blocks; these blocks are all of monday" in reported
    )
    updated = Site.open(tmp_path / "four.site")
    points_m = seen_from(cloud, planar(1.5, 0.5, 40))
    assert Site.open(site).localize(points_m).verdict != "accepted"
    fix = updated.localize(points_m)
    assert (fix.verdict, fix.place) == ("accepted", 3)
    np.testing.assert_allclose(fix.world_T_sensor, FOURTH @ planar(1.5, 0.5, 40), atol=0.1)
    for row in range(3):
        fix = updated.localize(seen_from(scene(row), planar(1, 1, 30)))
        assert (fix.verdict, fix.place) == ("accepted", row)
    assert "tuesday (3 views, 1 new places, 0 submaps changed)" in str(
        describe(tmp_path / "four.site")
    )
    assert "; these blocks are all of monday" in str(describe(tmp_path / "four.site"))
    assert "these blocks are all of" not in str(describe(site))


def test_without_a_file_nothing_is_written(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = site.read_bytes()
    log = drive(tmp_path / "wednesday", dict.fromkeys([0.0, 1.0], scene(0)))
    with pytest.raises(SystemExit):
        main(["update", str(site), log, "--target-precision", "0.999", "--strict"])
    assert (
        "target_precision=0.999: this site has no threshold for it; it has thresholds for 0.95, 0.99"
        in capsys.readouterr().err
    )
    main(["update", str(site), log, "--target-precision", "0.999"])
    assert "this site can keep .99, not .999: accepted means .99" in capsys.readouterr().err
    main(["update", str(site), log])
    reported = capsys.readouterr()
    assert "2 of 2 scans pseudo-labelled; 0 new places beside 3" in reported.out
    assert "nothing was written" in reported.err
    assert site.read_bytes() == before


def test_a_changed_submap_is_replaced_by_the_scan_that_contradicts_it(site: Path) -> None:
    parts = site_file.read(site, views=True)
    opened = Site(parts)
    clouds = (scene(5), scene(6))
    poses = np.array([ANCHORS[0], FOURTH])
    pseudo_labels = PseudoLabels(
        clouds, np.arange(2), poses, np.ones(2), np.zeros(2, bool), True, 2
    )
    plan = Update(pseudo_labels, opened.places, np.array([0, -1]), {0: 0}, np.array([1]))
    updated = updated_map(opened, parts, plan)
    np.testing.assert_array_equal(
        updated["world_T_anchor"], np.array([ANCHORS[1], ANCHORS[2], *poses])
    )
    kept = parts.arrays["points"][parts.arrays["offsets"][1] :]
    offsets = updated["offsets"]
    np.testing.assert_array_equal(updated["points"][: offsets[2]], kept)
    assert len(updated["points"]) == offsets[-1] > offsets[3] > offsets[2]


def test_scans_that_lie_in_no_place_are_not_learned(site: Path) -> None:
    opened = Site(site_file.read(site))
    cloud = (scene(0),)
    away = PseudoLabels(
        cloud,
        np.zeros(1, np.int64),
        np.array([planar(100, 0, 0)]),
        np.ones(1),
        np.zeros(1, bool),
        False,
        3,
    )
    with pytest.raises(
        NoPseudoLabelsError,
        match="nothing to learn of 3 scans: those pseudo-labelled lie in no place",
    ):
        planned(opened, away)
    keeps_nothing = replace(
        opened.description.verdict, claim_thresholds=dict.fromkeys(CLAIMS, (-1.0, -1.0, -1.0))
    )
    opened.description = replace(opened.description, verdict=keeps_nothing)
    with pytest.raises(
        NoPseudoLabelsError, match="nothing to learn of 0 scans: the site can keep no target"
    ):
        from_site(opened, [], 0.999)


def test_a_kill_while_writing_leaves_the_old_site(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "own.site"
    copy.write_bytes(site.read_bytes())
    log = drive(tmp_path / "friday", dict.fromkeys([0.0, 1.0], scene(0)))

    def cut(path: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(replacing, "_fsync", cut)
    with pytest.raises(SystemExit):
        main(["update", str(copy), log, "-o", str(copy)])
    assert copy.read_bytes() == site.read_bytes()
    monkeypatch.undo()
    main(["update", str(copy), log, "-o", str(copy)])
    assert [
        learned.day for learned in site_file.read(copy).description.incremental_learning.days
    ] == [
        "monday",
        "friday",
    ]


def test_a_site_without_views_cannot_be_updated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["update", str(packed(tmp_path)), str(tmp_path)])
    assert "holds no views to learn from" in capsys.readouterr().err


def test_a_site_learns_a_drive_by_itself_and_one_that_it_does_not_know_changes_nothing(
    site: Path,
) -> None:
    known, unknown = (
        [
            Scan("s", None, partial(seen_from, scene(seed), planar(x_m, 0, 0)), NO_POSE, NO_POSE)
            for x_m in (0, 1)
        ]
        for seed in (0, 9)
    )
    first, second, third = self_trained(
        site, SelfTrained(0.99), {"known": known, "unknown": unknown}, Progress()
    )
    assert (first.name, first.counts) == ("monday", {})
    assert second.counts == {"queried": 2, "pseudo_labelled": 2, "wrong": 0, "changed": 0}
    assert third.counts == {"queried": 2, "pseudo_labelled": 0, "wrong": 0, "changed": 0}
    assert third.bytes == second.bytes > first.bytes
