"""The command that draws a moving picture, and the files of such pictures."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.cli import main
from pipeline.cli.picture import last_day
from pipeline.core import schemas
from pipeline.report.figures.accepted import AcceptedDrive
from pipeline.report.figures.animation import END_MS, FRAME_MS, palette, save, spread
from pipeline.report.study import StudyResults
from pipeline.studies.layout import Layout
from pipeline.studies.studies_file import studies_text
from tests.artifacts import write_scans
from tests.report.studied import SETTINGS, TESTS, TRAIN
from tests.studies.made import CONF

DAY = "2012-02-04"
POST_M = np.array([(6.0, 0.0, 1.0), (6.0, 0.0, 2.0)])


@pytest.fixture(scope="module")
def scanned(study: StudyResults, tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    """The study with its scans, each of which sees a post 6 m ahead."""
    root = tmp_path_factory.mktemp("scanned") / "artifacts"
    root.mkdir()
    for kind in study.layout.root.iterdir():
        (root / kind.name).symlink_to(kind)
    scanned = replace(study, layout=Layout(root))
    for sequence in (TRAIN, DAY, max(TESTS)):
        world_T_anchor = study.artifact(schemas.Submaps, "submaps", sequence).world_T_anchor
        posts_m = [POST_M] * len(world_T_anchor)
        write_scans(scanned.find("scans", sequence), posts_m, world_T_anchor)
    return scanned


@pytest.fixture
def project(scanned: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with that study alone, to call the command in."""
    shutil.copytree(CONF, tmp_path / "conf")
    (tmp_path / "conf/studies.yaml").write_text(studies_text({"campus": SETTINGS}))
    (tmp_path / "artifacts").symlink_to(scanned.layout.root)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_scan_without_a_pose_is_drawn_where_its_place_is(scanned: StudyResults) -> None:
    drive = AcceptedDrive.of(scanned, "sci", DAY)
    answers_m = drive.world_T_query[:, :2, 3]
    assert (drive.posed, drive.target_precision) == (False, None)
    np.testing.assert_allclose(
        drive.placed_points_m(0)[:, :2], [answers_m[0] + (6.0, 0.0)] * 2, atol=0.01
    )
    assert drive.right.tolist() == [True, True, False, True, True, False, False]


def test_a_short_drive_has_a_frame_a_query_and_a_long_one_ends_with_its_last() -> None:
    assert spread(7, 90).tolist() == list(range(7))
    shown = spread(1000, 130)
    assert (len(shown), shown[0], shown[-1]) == (130, 0, 999)
    assert set(np.diff(shown)) == {7, 8}


def test_the_file_repeats_for_ever_and_stays_at_its_last_frame(tmp_path: Path) -> None:
    frames = [np.full((8, 8, 3), grey, np.uint8) for grey in (0, 120, 255)]
    table = palette(("#000000",), ("#787878",))
    assert save(frames, tmp_path / "a.gif", table)[0] == 3
    with Image.open(tmp_path / "a.gif") as image:
        assert (image.n_frames, image.info["loop"]) == (3, 0)
        lasting = []
        for frame in range(3):
            image.seek(frame)
            lasting.append(image.info["duration"])
    assert lasting == [FRAME_MS] * 2 + [END_MS]


def test_the_command_draws_the_last_day_or_another(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # the oldest day, wherever it is listed
    backwards = replace(SETTINGS, tests=SETTINGS.tests[::-1])
    (project / "conf/studies.yaml").write_text(studies_text({"campus": backwards}))
    main(["picture", "campus/10m/sci-4way", "-o", "year.webp"])
    assert f"driven {max(TESTS)}, 287 days later: " in capsys.readouterr().out
    main(["picture", "campus/10m/sci", DAY, "-o", "year.png"])
    size = Path("year.png").stat().st_size
    # the third answer is 200 m off, training never saw the last two queries
    line = (
        f"year.png: Learned {TRAIN}, driven {DAY}, 20 days later: 5 answers accepted, 2 wrong "
        "among them; 2 refused, 1 wrong among them, simulated; 7 frames, "
    )
    assert capsys.readouterr().out == f"{line}{size / 1e6:.2f} MB\n"
    for name in ("year.webp", "year.png"):
        with Image.open(name) as image:
            assert image.n_frames == 7


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("campus/sci -o a.gif", "campus/sci: expected STUDY/GRID/METHOD"),
        ("town/10m/sci -o a.gif", "no such study and grid, expected one of campus/10m"),
        ("campus/5m/sci -o a.gif", "no such study and grid, expected one of campus/10m"),
        ("campus/10m/sad -o a.gif", "no such method, expected one of sci, sci-4way, scan_context"),
        (
            "campus/10m/sci 1999-01-01 -o a.gif",
            "1999-01-01: no such test day, expected one of 2012-02-04, ",
        ),
        ("campus/10m/sci -o a.mp4", "a.mp4: expected a name that ends in .gif, .webp, .png"),
        ("campus/10m/sci -o there/a.gif", "there/a.gif: no folder there"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    project: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["picture", *words.split()])
    (line,) = capsys.readouterr().err.splitlines()
    assert (stop.value.code, said in line) == (1, True), line
    assert not list(project.glob("a.*"))


def test_what_is_not_built_yet_is_one_line(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (project / "artifacts").unlink()
    with pytest.raises(SystemExit):
        main(["picture", "campus/10m/sci", "-o", "a.gif"])
    (line,) = capsys.readouterr().err.splitlines()
    assert "no results yet; `dvc repro` gathers them" in line


def test_the_last_day_is_found_though_some_rows_are_of_no_day() -> None:
    days = {"2012-02-04": 20.0, "2013-04-05": 446.0}
    rows = [{"sequence": day, "days": age} for day, age in days.items()] + [
        {"sequence": day, "days": np.nan} for day in days
    ]
    assert last_day(pd.DataFrame(rows), [*days]) == "2013-04-05"
    assert last_day(pd.DataFrame(rows[::-1]), [*days]) == "2013-04-05"
