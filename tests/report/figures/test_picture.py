"""The moving picture: what became of each query, how many frames there are, what a frame shows, and
the command."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from pipeline.cli import main
from pipeline.cli.picture import last_day
from pipeline.core import schemas, store
from pipeline.core.progress import Progress
from pipeline.report.figures.animation import END_MS, FRAME_MS, spread
from pipeline.report.figures.drive import NOT_COUNTED, RIGHT, WRONG, Drive, Views, walls
from pipeline.report.figures.picture import FRAMES, TINTS, Canvas, frames, write
from pipeline.report.figures.style import SIMULATED
from pipeline.report.study import Study
from pipeline.studies.layout import Layout
from pipeline.studies.names import studies_text
from tests.report.site import heights
from tests.report.studied import SETTINGS, TESTS, TRAIN
from tests.studies.made import CONF

DAY = "2012-02-04"
OUTCOMES = [RIGHT, RIGHT, WRONG, RIGHT, RIGHT, NOT_COUNTED, NOT_COUNTED]
"""Of SCI on that day: the third answer is 200 m off, training never saw the last two queries."""
ENDS = np.array([6])
"""The last query."""


@pytest.fixture(scope="module")
def drive(study: Study) -> Drive:
    return Drive.of(study, "sci", DAY)


@pytest.fixture(scope="module")
def file(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The picture as a GIF."""
    path = tmp_path_factory.mktemp("picture") / "year.gif"
    assert write(drive, path, Progress()) == (7, path.stat().st_size)
    return path


@pytest.fixture
def project(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with that study alone, to call the command in."""
    shutil.copytree(CONF, tmp_path / "conf")
    (tmp_path / "conf/studies.yaml").write_text(studies_text({"campus": SETTINGS}))
    (tmp_path / "artifacts").symlink_to(study.layout.root)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rgb(tint: str) -> np.ndarray:
    return np.rint(255 * np.array(to_rgb(tint))).astype(np.uint8)


def pixels(path: Path, frame: int) -> np.ndarray:
    """A frame of the file (height, width, 3)."""
    with Image.open(path) as image:
        image.seek(frame)
        return np.asarray(image.convert("RGB"))


def at(drive: Drive, frame: np.ndarray, query: int) -> np.ndarray:
    """The colour on the map where a query was."""
    canvas = Canvas(replace(drive, views=None))
    canvas.drawn(0, None)  # lays the map out
    x_px, y_px = canvas.robot.axes.transData.transform(drive.xy_m[query])
    return frame[int(len(frame) - y_px), int(x_px)]


def test_the_outcomes_are_those_of_the_evaluation_and_end_in_its_recall(
    study: Study, drive: Drive
) -> None:
    assert drive.outcome.tolist() == OUTCOMES
    assert drive.counted.tolist() == [[1, 2, 3, 4, 5, 5, 5], [1, 2, 2, 3, 4, 4, 4]]
    assert drive.driven_m.tolist() == [0, 10, 20, 30, 40, 140, 160]
    assert drive.error_m[:4].tolist() == [1, 1, 200, 6]
    for result in study.results:
        counted, right = Drive.of(study, result.model, result.sequence).counted[:, -1]
        assert right / counted == pytest.approx(result.number("distance", "recall_at_1"))


@pytest.mark.parametrize(
    ("days", "words"),
    [(446, "446 days later"), (1, "1 day later"), (0, "the same day"), (-3, "3 days earlier")],
)
def test_the_title_says_both_days_and_what_lies_between(
    drive: Drive, days: int, words: str
) -> None:
    assert replace(drive, days=days).title == f"Learned {TRAIN}, driven {DAY}, {words}"


def test_a_matched_view_is_rolled_to_look_like_its_query_and_is_missing_without_an_answer(
    drive: Drive,
) -> None:
    seen = heights(50)
    answers = drive.train_xy_m[[40, 7]]
    asked = np.stack([np.roll(seen[40], 30, axis=1), np.roll(seen[7], -13, axis=1), seen[1]])
    own = replace(drive, answer_xy_m=np.vstack([answers, [[np.nan, np.nan]]]))
    pairs = own.pairs(Views(asked, seen), np.arange(3))
    assert (pairs[:, 0] == asked).all()
    assert (pairs[:2, 1] == asked[:2]).all()
    assert np.isnan(pairs[2, 1]).all()


def test_walls_are_what_stands_high_and_was_seen_often(study: Study, tmp_path: Path) -> None:
    """From each of 50 scans a post at (30.1, 5.1), 3 m high, and a kerb beside it; from the first
    one a passer at (60.1, 5.1)."""
    own = replace(study, layout=Layout(tmp_path))
    assert own.layout != study.layout
    shutil.copytree(study.find("submaps", TRAIN), own.find("submaps", TRAIN))
    assert walls(own, TRAIN).shape == (0, 2)  # no scans
    x_m = own.train_xy_m[:, 0]
    stands = np.array([(30.1, 5.1, 3.0), (30.1, -5.1, 0.5)])
    points_m = stands[None] - np.stack([x_m, 0 * x_m, 0 * x_m], axis=1)[:, None]
    points_m = np.vstack([[(60.1 - x_m[0], 5.1, 3.0)], points_m.reshape(-1, 3)])
    with store.draft(
        own.find("scans", TRAIN), schemas.Scans, grain_m=0.005, skipped={}, clipped=0
    ) as draft:
        draft.put("points", np.rint(points_m / 0.005).astype(np.int16))
        draft.put("offsets", np.array([0, *range(3, 102, 2)]))
        draft.put("stamps_ns", np.arange(50))
        for name in ("world_T_scan", "odom_T_scan"):
            draft.put(name, own.artifact(schemas.Submaps, "submaps", TRAIN).world_T_anchor)
        draft.put("odom_variance", np.full((50, 2), np.nan))
    np.testing.assert_allclose(walls(own, TRAIN), [[30.1, 5.1]], atol=0.3)


def test_a_short_drive_has_a_frame_a_query_and_a_long_one_ends_with_its_last(drive: Drive) -> None:
    assert spread(len(drive.xy_m), FRAMES).tolist() == list(range(7))
    shown = spread(1000, FRAMES)
    assert (len(shown), shown[0], shown[-1]) == (FRAMES, 0, 999)
    assert set(np.diff(shown)) == {7, 8}


def test_the_file_repeats_for_ever_and_stays_at_its_last_frame(
    drive: Drive, file: Path, tmp_path: Path
) -> None:
    with Image.open(file) as image:
        assert (image.n_frames, image.info["loop"]) == (7, 0)
        lasting = []
        for frame in range(7):
            image.seek(frame)
            lasting.append(image.info["duration"])
    assert lasting == [FRAME_MS] * 6 + [END_MS]
    assert write(drive, tmp_path / "again.gif", Progress())[0] == 7
    assert (tmp_path / "again.gif").read_bytes() == file.read_bytes()


def test_a_dot_stays_behind_in_the_colour_of_its_outcome(drive: Drive, file: Path) -> None:
    last = pixels(file, 6)
    third = pixels(file, 2)
    for query, outcome in enumerate(OUTCOMES[:6]):  # the robot stands on the last one
        assert (at(drive, last, query) == rgb(TINTS[outcome])).all()
    assert (at(drive, third, 1) == rgb(TINTS[RIGHT])).all()
    assert not (at(drive, third, 3) == rgb(TINTS[RIGHT])).all()  # not yet there
    wrong = [
        int((pixels(file, frame) == rgb(TINTS[WRONG])).all(axis=2).sum()) for frame in range(7)
    ]
    assert (
        0 < wrong[0] == wrong[1] < wrong[3] < wrong[2]
    )  # the legend's; the dot; the dot and the way to the answer
    assert wrong[3] == wrong[6]


def test_a_frame_says_the_share_so_far_and_how_far_off_the_answer_is(drive: Drive) -> None:
    canvas = Canvas(drive)
    said = []
    for query in (0, 2, 6):
        canvas.drawn(query, drive.pairs(drive.views, np.array([query]))[0] if drive.views else None)
        said.append(tuple(text.get_text() for text in (canvas.number, canvas.counts, canvas.off)))
    assert said == [
        ("100.0 %", "1 of 1 answers are right", "1 m off"),
        ("66.7 %", "2 of 3 answers are right", "200 m off"),
        ("80.0 %", "4 of 5 answers are right", "not counted"),
    ]


def test_simulated_stands_on_every_frame_of_simulated_drives_alone(drive: Drive) -> None:
    for simulated in (True, False):
        own = replace(drive, simulated=simulated)
        assert (SIMULATED in [text.get_text() for text in Canvas(own).figure.texts]) == simulated
        (frame,) = frames(own, ENDS)
        assert (frame[:36, 640:] < 255).any() == simulated


def test_without_scan_contexts_a_frame_shows_no_views(drive: Drive) -> None:
    (seen,) = frames(drive, ENDS)
    (unseen,) = frames(replace(drive, views=None), ENDS)
    box = np.s_[94:160, 520:880]
    assert (seen[box] < 255).any(axis=2).all()
    assert (unseen[box] == 255).all()


def test_answers_that_are_none_are_wrong_and_drawn_as_such(drive: Drive) -> None:
    """As of a model with poses that finds none."""
    own = replace(drive, answer_xy_m=np.full((7, 2), np.nan), outcome=np.full(7, WRONG))
    canvas = Canvas(own)
    canvas.drawn(1, own.pairs(own.views, np.array([1]))[0] if own.views else None)
    assert (canvas.off.get_text(), canvas.number.get_text()) == ("no answer", "0.0 %")


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
    line = (
        f"year.png: Learned {TRAIN}, driven {DAY}, 20 days later: 4 of 5 answers right within 15 "
        "m, simulated; 7 frames, "
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
