"""Figures of paper 2: curves and indices by heading, what networks learned, and the octree's
bird-view."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from pipeline.evaluation.viewpoints import ViewpointMatches
from pipeline.mapping.octree import Octree
from pipeline.report.figures import viewpoints, views
from pipeline.report.figures.style import colour
from pipeline.views.birdview import BirdView
from tests.report.figures.made import saved_alike, words

RIGHT = np.ones(4, bool)
HALF = np.array([1, 0, 1, 0], bool)
WRONG = np.zeros(4, bool)
NO_PICTURES = np.zeros((0, 4, 4), np.uint8)


def at(*correct: np.ndarray) -> ViewpointMatches:
    """Four queries from each of some headings, of falling score, matched 1 m off or 80 m off."""
    right = np.stack(correct)
    nothing = np.zeros((len(correct), 4))
    return ViewpointMatches(
        headings_deg=(np.arange(len(correct)) + 0.5) * 360 / len(correct),
        row=nothing.astype(int),
        answer_xy_m=np.zeros((len(correct), 4, 2)),
        error_m=np.where(right, 1.0, 80.0),
        correct=right,
        valid=np.ones(4, bool),
        score=np.tile(np.array([4, 3, 2, 1], np.float32), (len(correct), 1)),
        xy_m=np.zeros((4, 2)),
        correct_m=10.0,
        length=10,
        novelty="cost",
        bytes_per_place=1.0,
        pictures=NO_PICTURES,
        reconstructed=NO_PICTURES,
    )


GROUP = {"pfl": [at(RIGHT, HALF), at(HALF, HALF)], "sad": [at(WRONG, HALF)]}
INDICES = {
    (model, name): np.array([[0.5, 0.9], [0.7, np.nan]])
    for model in ("pfl", "sad")
    for name in viewpoints.INDICES
}
LEARNED = {
    "code_variance": np.array([0.4, 0.1]),
    "code_distance": np.array([8.0, 2.0]),
    "held_out_error": np.array([0.5, 0.25]),
    "black_error": np.array([0.125, 0.125]),
}
CURVES = {"pfl": [LEARNED, {name: 3 * curve for name, curve in LEARNED.items()}], "sad": [{}]}
SEEN = np.zeros((16, 4, 4), np.uint8)
SEEN[:, 0, 0] = np.arange(16)
VIEW = BirdView(Octree(edge_m=32.0, depth=6), side_px=32)


def pose(x: float, y: float, yaw: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix


def wall() -> np.ndarray:
    """Points (n, 3) of a wall 8 m ahead, 8 m wide and 3 m high, and of the ground before it."""
    upright = np.stack(
        np.meshgrid([8.2], np.arange(-3.9, 4, 0.2), np.arange(0.1, 3, 0.2)), -1
    ).reshape(-1, 3)
    ground = np.stack(
        np.meshgrid(np.arange(2, 8, 0.25), np.arange(-3.9, 4, 0.25), [0.0]), -1
    ).reshape(-1, 3)
    return np.concatenate([upright, ground])


def bird_view() -> Figure:
    octree_map = VIEW.octree.grow()
    octree_map.insert(wall(), pose(3.0, 1.0, 0.3))
    return views.bird_view(wall(), octree_map, pose(3.0, 1.0, 0.3), VIEW)


FIGURES: list[Callable[[], Figure | None]] = [
    lambda: viewpoints.precision_recall(GROUP, "a"),
    lambda: viewpoints.indices(INDICES, (90.0, 270.0), 10.0),
    lambda: viewpoints.reconstructions({"pfl": (SEEN, SEEN)}),
    lambda: viewpoints.collapse(CURVES),
    bird_view,
]


def lines(axis: Axes, model: str) -> list[np.ndarray]:
    return [
        np.asarray(line.get_xydata())
        for line in axis.lines
        if to_hex(line.get_color()).upper() == colour(model)
    ]


@pytest.mark.parametrize("draw", FIGURES)
def test_a_figure_of_simulated_data_says_so_and_is_the_same_file_each_time(
    draw, tmp_path: Path
) -> None:
    saved_alike(draw, tmp_path)


def test_curves_have_a_panel_a_heading_a_line_a_seed_and_the_accuracy_in_words() -> None:
    first, second = viewpoints.precision_recall(GROUP, "a").axes
    assert (first.get_title(), second.get_title()) == (
        "90°",
        "270°",
    )  # two headings: half way between 0° and 180°
    assert lines(second, "sad")[0] == pytest.approx(
        np.array([[0, 1], [0.5, 1], [0.5, 0.5], [1, 2 / 3], [1, 0.5]])
    )
    assert len(lines(second, "pfl")) == 2
    assert not lines(first, "sad")  # without a correct match recall is of nothing
    sad, pfl = first.texts
    assert (sad.get_text(), pfl.get_text(), sad.get_ha()) == (
        "0.000",
        "0.750",
        "left",
    )  # pfl: (1 + 1/2)/2 over its seeds
    assert sad.xyann < pfl.xyann  # in the legend's order


def test_the_accuracies_of_poor_models_stand_where_no_curve_is() -> None:
    pfl, sad = (
        viewpoints.precision_recall({"pfl": [at(HALF)], "sad": [at(WRONG)]}, "a").axes[0].texts
    )
    assert (pfl.get_text(), sad.get_text(), pfl.get_ha()) == ("0.500", "0.000", "right")
    assert sad.xyann < pfl.xyann


def test_each_index_is_the_mean_over_sequences_and_seeds_and_a_missing_one_a_gap() -> None:
    roc, _, accuracy, _ = viewpoints.indices(INDICES, (90.0, 270.0), 10.0).axes
    assert (roc.get_title(), accuracy.get_title()) == (
        "ROC-AUC, the paper's index",
        "accuracy within 10 m",
    )
    (pfl,) = lines(accuracy, "pfl")
    (sad,) = lines(accuracy, "sad")
    assert pfl[:, 1] == pytest.approx([0.6, 0.9])
    assert len(accuracy.collections[0].get_offsets()) == 4
    assert pfl[0, 0] < sad[0, 0]  # side by side
    assert [text.get_text() for text in roc.get_xticklabels()] == ["90°", "270°"]
    nothing = {key: np.full((1, 2), np.nan) for key in INDICES}
    assert np.isnan(
        lines(viewpoints.indices(nothing, (90.0, 270.0), 10.0).axes[0], "pfl")[0][:, 1]
    ).all()


def test_reconstructions_stand_below_what_was_seen_at_every_other_heading_with_their_error() -> (
    None
):
    pictures = {"pfl": (SEEN, SEEN), "afl": (SEEN, np.full_like(SEEN, 255))}
    axes = np.reshape(viewpoints.reconstructions(pictures).axes, (3, 8))
    assert [axis.get_title() for axis in axes[0]] == [
        "0°",
        "45°",
        "90°",
        "135°",
        "180°",
        "225°",
        "270°",
        "315°",
    ]
    assert [axis.images[0].get_array()[0, 0] for axis in axes[0]] == list(range(0, 16, 2))
    assert [line[0].get_ylabel() for line in axes] == ["seen", "pfl", "afl"]
    assert {axis.get_xlabel() for axis in axes[1]} == {"0.000"}
    # All white of black but for one of sixteen pixels, 0 to 14 of 255: (255/127.5)² = 4, and ((255
    # − 14)/127.5)²/16 + 4·15/16.
    assert (axes[2, 0].get_xlabel(), axes[2, 7].get_xlabel()) == (
        "4.000",
        f"{(241 / 127.5) ** 2 / 16 + 3.75:.3f}",
    )
    others = {
        "pfl": (SEEN[:3], SEEN[:3]),
        "afl": (SEEN[3:6], SEEN[3:6]),
        "sad": (SEEN[3:6], SEEN[3:6]),
    }
    assert [axis.get_ylabel() for axis in viewpoints.reconstructions(others).axes[::3]] == [
        "seen",
        "pfl",
        "seen",
        "afl",
        "sad",
    ]


def test_collapse_is_shown_by_a_line_a_seed_of_the_models_that_have_the_curves() -> None:
    fig = viewpoints.collapse(CURVES)
    assert fig is not None
    assert [line[:, 1].tolist() for line in lines(fig.axes[0], "pfl")] == [
        [0.4, 0.1],
        pytest.approx([1.2, 0.3]),
    ]
    assert lines(fig.axes[1], "pfl")[0].tolist() == [[1, 8.0], [2, 2.0]]
    assert [set(line.get_ydata()) for line in fig.axes[2].lines[-2:]] == [{0.125}, {0.375}]
    assert "a black image" in words(fig)
    assert "sad" not in words(fig)
    assert viewpoints.collapse({"sad": [{}]}) is None


@pytest.mark.parametrize("place", [pose(0, 0, 0), pose(40.2, -3.1, 2.0)])
@pytest.mark.parametrize(("depth", "edge_m"), [(6, 0.5), (4, 2.0)])
def test_squares_lie_where_the_wall_is_with_the_height_of_its_top(
    place: np.ndarray, depth: int, edge_m: float
) -> None:
    octree_map = VIEW.octree.grow()
    octree_map.insert(wall(), place)
    corners_m, heights_m = views.tops(octree_map, place, VIEW, depth)
    middles_m = corners_m.mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(corners_m[:, 1] - corners_m[:, 0], axis=1), edge_m)
    assert np.abs(middles_m[:, 0] - 8.2).max() <= edge_m * 0.71
    assert np.abs(middles_m[:, 1]).max() < 4 + edge_m * 0.71
    assert np.ptp(middles_m[:, 1]) > 8 - 2 * edge_m
    np.testing.assert_allclose(heights_m, 2.75)  # the highest leaf is from 2.5 m to 3 m
