"""Tests of paper 2's protocol: a sequence is matched with itself from other headings, and the
matches are judged."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from sklearn import metrics

from pipeline.core import store
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import yaw
from pipeline.core.progress import Progress
from pipeline.evaluation.viewpoint_matches import NUMBERS, ViewpointMatches, Viewpoints, turned
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from tests.evaluation.made import judged, standing

STEP_M = 3.0
SIDE = 32


POSTS_M = np.random.default_rng(3).uniform((-40, -40), (120, 140), (900, 2))


def drive(n: int = 30, headings: int = 16) -> Rows:
    """A row every 3 m north, then bending east, past random posts: what is seen from each heading
    is drawn for itself."""
    heading = np.linspace(np.pi / 2, 0, n)
    more = 2 * np.pi * np.arange(headings) / headings
    xy_m = np.cumsum(STEP_M * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    images = [
        [seen(*place, ahead + left) for left in more]
        for place, ahead in zip(xy_m, heading, strict=True)
    ]
    return Rows(np.array(images), np.arange(n), standing(xy_m, np.rad2deg(heading)))


def seen(x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
    """A bird-view (32, 32) of 32 m: row 0 in front, column 0 on the left."""
    east, north = (POSTS_M - (x_m, y_m)).T
    forward = east * np.cos(yaw_rad) + north * np.sin(yaw_rad)
    left = north * np.cos(yaw_rad) - east * np.sin(yaw_rad)
    inside = (np.abs(forward) < 16) & (np.abs(left) < 16)
    image = np.zeros((SIDE, SIDE), np.uint8)
    image[(16 - forward[inside]).astype(int), (16 - left[inside]).astype(int)] = 255
    return image


@dataclass
class Fake:
    """Finds the nearest reference image, blurred to 8 × 8, at any even heading; keeps its
    queries."""

    view: str = "birdview"
    length: int = 4
    asked: list[Rows] = field(default_factory=list)
    moves: list[tuple[Model, Rows, np.ndarray]] = field(default_factory=list)

    def learn(self, views: Rows, places: np.ndarray, watch: Progress) -> Model:
        return self.moved({}, views, places)

    def moved(self, model: Model, views: Rows, places: np.ndarray) -> Model:
        self.moves.append((model, views, places))
        kept = {"evidence": np.zeros(5)} | {
            name: array for name, array in model.items() if name == "evidence"
        }
        return kept | {
            "codes": small(views.images[:, ::2]),
            "xy_m": views.world_T_anchor[:, :2, 3],
            "places": places,
        }

    def reconstructed(self, model: Model, images: np.ndarray) -> np.ndarray:
        return 255 - images

    def localizer(self, model: Model) -> Localizer:
        def localize(views: Rows, k: int) -> Ranking:
            self.asked.append(views)
            # (q, n, heading)
            away = np.linalg.norm(model["codes"] - small(views.images[:, :1])[:, None], axis=3)
            row = away.min(axis=2).argmin(axis=1)
            return ranking(model["xy_m"][row], away.min(axis=(1, 2)), model["places"][row])

        return localize


def small(images: np.ndarray) -> np.ndarray:
    blocks = images.reshape(*images.shape[:2], 8, SIDE // 8, 8, SIDE // 8).mean(axis=(3, 5))
    return blocks.reshape(*images.shape[:2], -1).astype(np.float32)


def ranking(xy_m: np.ndarray, novelty: np.ndarray, row: np.ndarray | None = None) -> Ranking:
    n = len(xy_m)
    row = np.zeros(n, np.int64) if row is None else row
    nan = np.full(n, np.nan, np.float32)
    new = novelty[:, None].astype(np.float32)
    return Ranking(row[:, None], new, xy_m[:, None], new, nan, nan[:, None], ("cost",))


class Scripted(Fake):
    """Answers by a function of the heading in degrees, which gives positions and novelties."""

    def __init__(
        self, answers: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]], length: int = 4
    ) -> None:
        super().__init__(length=length)
        self.answers = answers

    def localizer(self, model: Mapping[str, np.ndarray]) -> Localizer:
        def localize(views: Rows, k: int) -> Ranking:
            more_deg = np.rad2deg(yaw(views.world_T_anchor)[-1]) % 360  # the drive ends with yaw 0
            return ranking(*self.answers(round(more_deg, 1), views.world_T_anchor[:, :2, 3]))

        return localize


VIEWS = drive()
MODEL = {"evidence": np.ones(5)}
AS_IS = Viewpoints()


def judge(method: Fake, views: Rows = VIEWS, viewpoints: Viewpoints = AS_IS) -> ViewpointMatches:
    return viewpoints.judge(method, MODEL, views)


def test_a_turned_query_shows_what_a_turned_robot_sees_at_the_same_places() -> None:
    # Heading 3 is 67.5° counter-clockwise: drawn again from the turned poses, every one of its 16
    # images is the same.
    query = turned(VIEWS, 3)
    assert np.rad2deg(yaw(query.world_T_anchor) - yaw(VIEWS.world_T_anchor)) % 360 == pytest.approx(
        67.5
    )
    assert (query.world_T_anchor[:, :, 3] == VIEWS.world_T_anchor[:, :, 3]).all()
    for i in (0, 17):
        pose = query.world_T_anchor[i]
        for j in (0, 1, 5):
            again = seen(*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0]) + 2 * np.pi * j / 16)
            assert (
                again != query.images[i, j]
            ).sum() <= 4  # of some 60 posts: the rounding of a post on a border
            assert (again != VIEWS.images[i, j]).sum() > 40
    left = turned(VIEWS, 4)  # a quarter turn to the left: what lay on the left lies in front
    assert (np.rot90(VIEWS.images[5, 0], -1) != left.images[5, 0]).sum() <= 4


def test_the_queries_are_the_odd_headings_and_the_reference_is_the_sequence_itself() -> None:
    method = Fake()
    result = judge(method)
    assert result.headings_deg.tolist() == [22.5, 67.5, 112.5, 157.5, 202.5, 247.5, 292.5, 337.5]
    assert [
        (rows.images[:, 0] == VIEWS.images[:, 2 * i + 1]).all()
        for i, rows in enumerate(method.asked)
    ] == [True] * 8
    model, reference, places = method.moves[0]
    assert model is MODEL
    assert (reference.images == VIEWS.images).all()
    assert (reference.world_T_anchor == VIEWS.world_T_anchor).all()
    assert places.tolist() == list(range(30))
    assert result.row.shape == (8, 30)
    assert result.error_m == pytest.approx(
        np.linalg.norm(result.xy_m[result.row] - result.xy_m, axis=2)
    )
    assert (result.novelty, result.length, result.correct_m) == ("cost", 4, 10.0)
    assert result.score.dtype == np.float32
    assert (result.score < 0).all()  # a distance's negative
    assert (
        result.pictures == VIEWS.images[15, ::2]
    ).all()  # the middle place at the reference's eight headings
    assert (result.reconstructed == 255 - result.pictures).all()
    # 8 codes of 64 float32 a place, 16 B of position and 8 B of place; the evidence does not grow
    assert result.bytes_per_place == 8 * 64 * 4 + 16 + 8


def test_a_method_that_knows_one_heading_alone_is_right_there_alone() -> None:
    # Elsewhere every second query is matched with its own place, less surely than the others with
    # one 50 m off.
    def answers(heading_deg: float, xy_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        odd = np.arange(len(xy_m)) % 2
        off_m = 0.0 if heading_deg == 22.5 else 50.0 * odd
        return xy_m + np.stack(
            [off_m * np.ones(len(xy_m)), np.zeros(len(xy_m))], axis=1
        ), 1.0 - 0.5 * odd

    result = judge(Scripted(answers))
    np.testing.assert_allclose(result.values, [[np.nan, 1, 1, 1], *[[0, 0.25, 0.5, 0]] * 7])
    numbers = result.by_heading()
    assert list(numbers) == [
        *(f"{deg}_deg" for deg in (22.5, 67.5, 112.5, 157.5, 202.5, 247.5, 292.5, 337.5)),
        "mean",
    ]
    assert numbers["22.5_deg"] == {"roc_auc": None, "pr_auc": 1.0, "accuracy": 1.0, "recall": 1.0}
    # Precision falls from 1 (nothing accepted) to 0 with the wrong half at recall 0, then rises to
    # 1/2 at recall 1: area 1/4.
    for heading, numbers_of_heading in list(numbers.items())[1:8]:
        assert numbers_of_heading == {
            "roc_auc": 0.0,
            "pr_auc": pytest.approx(0.25),
            "accuracy": 0.5,
            "recall": 0.0,
        }, heading
    assert numbers["mean"] == {
        "roc_auc": 0.0,  # of the seven that have one
        "pr_auc": pytest.approx((1 + 7 * 0.25) / 8),
        "accuracy": pytest.approx((1 + 7 * 0.5) / 8),
        "recall": pytest.approx(1 / 8),
    }


@pytest.mark.parametrize(
    ("viewpoints", "accuracy"),
    [(AS_IS, 2 / 4), (Viewpoints(10.1), 3 / 4), (Viewpoints(9.5), 1 / 4), (Viewpoints(5.0), 0.0)],
)
def test_a_match_is_correct_up_to_ten_metres_off_whatever_the_direction(
    viewpoints: Viewpoints, accuracy: float
) -> None:
    # 9.4 m off, 6 and 8 m (10 m, and 14 by the block), 10.05 m, and nowhere; the first and last two
    # rows are not valid.
    off_m = np.array(
        [[0, 0], [0, 0], [9.4, 0], [-6, 8], [0, -10.05], [np.nan, np.nan], [0, 0], [0, 0]]
    )
    poses = np.tile(np.eye(4), (8, 1, 1))
    views = Rows(VIEWS.images[:8], VIEWS.stamps_ns[:8], poses)
    result = judge(Scripted(lambda _, xy_m: (xy_m + off_m, np.arange(8.0))), views, viewpoints)
    assert [one["accuracy"] for one in result.by_heading().values()] == [accuracy] * 9


def test_only_rows_with_a_whole_window_around_them_are_valid() -> None:
    # METHODS.md 6: 30 queries in windows of 10 steps leave five at either end without an answer.
    xy_m = VIEWS.world_T_anchor[:, :2, 3]
    off_m = np.where((np.arange(30) >= 5) & (np.arange(30) <= 24), 0.0, 99.0)[:, None]
    result = judge(Scripted(lambda _, places_m: (places_m + off_m, np.zeros(30)), length=10))
    assert np.flatnonzero(result.valid).tolist() == list(range(5, 25))
    assert result.by_heading()["mean"]["accuracy"] == 1.0
    assert result.correct.sum(axis=1).tolist() == [20] * 8
    assert (result.xy_m == xy_m).all()
    short = judge(
        Fake(length=10), Rows(VIEWS.images[:10], VIEWS.stamps_ns[:10], VIEWS.world_T_anchor[:10])
    )
    assert not short.valid.any()
    assert all(value is None for one in short.by_heading().values() for value in one.values())


@pytest.mark.parametrize("ties", [1000, 7])
def test_the_areas_are_those_of_scikit_learn(ties: int) -> None:
    rng = np.random.default_rng(ties)
    correct = rng.random((2, 90)) < 0.6
    score = (rng.integers(0, ties, (2, 90)) + 0.3 * ties * correct).round().astype(np.float32)
    result = judged(correct, score)
    for i, numbers in enumerate(list(result.by_heading().values())[:2]):
        precision, recall, _ = metrics.precision_recall_curve(correct[i], score[i])
        assert numbers["roc_auc"] == pytest.approx(metrics.roc_auc_score(correct[i], score[i]))
        assert numbers["pr_auc"] == pytest.approx(metrics.auc(recall, precision))
        ours = np.stack(result.curve(i))
        assert ours == pytest.approx(np.stack([precision, recall])[:, ::-1])


def test_recall_is_of_all_valid_queries_at_the_last_threshold_that_is_precise() -> None:
    # As the score falls: 100 correct, a wrong (100/101 = .9901), a correct, a wrong (101/103 <
    # .99), 7 correct (108/110 = .982).
    correct = np.array([True] * 100 + [False, True, False] + [True] * 7)
    means = judged(correct[None], -np.arange(110.0)[None]).by_heading()["mean"]
    assert means["recall"] == pytest.approx(101 / 110)  # and not 101 of the 108 correct
    assert means["accuracy"] == pytest.approx(108 / 110)
    nothing = judged(np.zeros((1, 5), bool), np.arange(5.0)[None]).by_heading()["mean"]
    assert nothing == {"roc_auc": None, "pr_auc": None, "accuracy": 0.0, "recall": 0.0}


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    result = judge(Fake())
    store.write(tmp_path / "a.zarr", result)
    again = store.read(tmp_path / "a.zarr", ViewpointMatches)
    assert again.by_heading() == result.by_heading()
    assert again.attrs == result.attrs
    assert again.numbers == NUMBERS
    for name in ViewpointMatches.columns:
        np.testing.assert_array_equal(again[name][:], result[name])


def test_views_that_were_not_drawn_at_headings_are_refused() -> None:
    with pytest.raises(InputError, match=r"shape \(30, 32, 32\)"):
        judge(Fake(), replace(VIEWS, images=VIEWS.images[:, 0]))
    with pytest.raises(InputError, match="even number"):
        judge(Fake(), replace(VIEWS, images=VIEWS.images[:, :15]))
    with pytest.raises(ConfigError, match=r"viewpoints\.correct_m=0"):
        Viewpoints(0.0)
