"""Places and labels: cells worked out by hand on a small grid, and counts on real trajectories."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import pose
from pipeline.core.grid import Grid
from pipeline.mapping.submaps import sample_path
from pipeline.matching.places import label

GRID = Grid(10.0, (0.0, 40.0), (0.0, 30.0))  # 4 × 3 cells, ids x-major


def anchors(*rows: tuple[float, float, float]) -> np.ndarray:
    """Poses (n, 4, 4) from rows of x, y and heading in degrees."""
    table = np.array(rows, float).reshape(-1, 3)
    zeros = np.zeros(len(table))
    return pose(
        np.column_stack([table[:, :2], zeros]),
        np.column_stack([zeros, zeros, np.deg2rad(table[:, 2])]),
    )


TRAINING = anchors((25, 5, 0), (5, 5, 90), (25, 6, 0), (35, 25, 180))  # cells 6, 0, 6, 11


def test_places_are_the_visited_cells_in_ascending_order() -> None:
    labels = label(TRAINING, TRAINING, GRID, 0)
    assert labels.cells.tolist() == [0, 6, 11]
    assert labels.places.tolist() == [1, 0, 1, 2]
    assert labels.oracle.tolist() == [1, 0, 1, 2]
    np.testing.assert_array_equal(labels.nearest_m, 0)
    np.testing.assert_array_equal(labels.nearest_turn_deg, 0)


@pytest.mark.parametrize(
    ("query", "place", "oracle", "nearest_m", "turn"),
    [
        ((8, 9, 90), 0, 0, 5, 0),  # (3, 4) m from (5, 5), and in its cell
        ((29, 9, 0), 1, 1, 5, 0),  # (4, 3) m from (25, 6)
        ((19, 5, -10), -1, 1, 6, -10),  # cell 3 was never visited; the nearest anchor is (25, 5)
        ((35, 21, 0), 2, 2, 4, 180),  # against the training heading: +180, never −180
        ((35, 25, -170), 2, 2, 0, 10),  # −170 − 180 = −350, that is 10
        ((5, 5, -100), 0, 0, 0, 170),  # −100 − 90 = −190, that is 170
        # outside the box: the border cell 11, which is place 2
        ((100, 100, 180), 2, 2, np.hypot(65, 75), 0),
        ((-3, 29, 0), -1, 0, np.hypot(8, 24), -90),  # outside the box, cell 2
    ],
)
def test_a_query_is_labelled_by_its_cell_and_by_its_nearest_anchor(
    query: tuple[float, float, float], place: int, oracle: int, nearest_m: float, turn: float
) -> None:
    labels = label(anchors(query), TRAINING, GRID, 0)
    assert (labels.places.tolist(), labels.oracle.tolist()) == ([place], [oracle])
    np.testing.assert_allclose(labels.nearest_m, nearest_m)
    np.testing.assert_allclose(labels.nearest_turn_deg, turn, atol=1e-9)


def test_the_oracle_may_lie_across_a_border_height_does_not_count_and_no_queries_have_no_labels() -> (
    None
):
    # (20.5, 5) is in cell 6, a place; the nearest anchor, (19.5, 5), in cell 3, another.
    labels = label(anchors((20.5, 5, 0)), anchors((19.5, 5, 0), (29, 5, 0)), GRID, 0)
    assert (labels.places.tolist(), labels.oracle.tolist()) == ([1], [0])
    above = anchors((25, 5, 0))
    above[0, 2, 3] = 50
    np.testing.assert_array_equal(label(above, TRAINING, GRID, 0).nearest_m, [0])
    labels = label(anchors(), TRAINING, GRID, 0)
    assert len(labels.places) == len(labels.oracle) == len(labels.nearest_m) == 0
    assert labels.cells.tolist() == [0, 6, 11]


# The four real trajectories: columns are seconds, x north, y east, z down, roll, pitch, heading,
# and one of no meaning.
NCLT = Grid(10.0, (-350.0, 130.0), (-730.0, 120.0))


def sampled(real: Path, date: str) -> np.ndarray:
    """Poses (n, 4, 4) about every metre of a sequence of NCLT."""
    rows = np.loadtxt(real / "nclt" / "trajectories" / f"{date}.txt")
    poses = pose(rows[:, 1:4], rows[:, 4:7])
    return poses[sample_path(poses[:, :3, 3], 1.0)]


def test_a_real_training_sequence_has_546_places(real: Path) -> None:
    training = sampled(real, "2012-01-08")
    assert len(training) == 5624
    assert len(label(training, training, NCLT, 0).cells) == 546


@pytest.mark.parametrize(
    ("date", "seen", "unseen"),
    [("2012-04-29", 2248, 497), ("2012-08-04", 3975, 767), ("2012-10-28", 3700, 1218)],
)
def test_real_test_sequences_are_seen_and_unseen_as_known(
    real: Path, date: str, seen: int, unseen: int
) -> None:
    labels = label(sampled(real, date), sampled(real, "2012-01-08"), NCLT, 0)
    assert (int((labels.places >= 0).sum()), int((labels.places < 0).sum())) == (seen, unseen)
    # The nearest anchor's place is the true one wherever that anchor shares the query's cell, and
    # then within a diagonal.
    assert labels.nearest_m[labels.places >= 0].max() <= 10 * np.sqrt(2)
    assert ((labels.nearest_turn_deg > -180) & (labels.nearest_turn_deg <= 180)).all()
