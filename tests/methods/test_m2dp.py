"""Tests of M2DP as a method: the nearest training signature is the answer, and a query far from all
of them is new."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, NoveltyEvidence, Rejection
from pipeline.methods.m2dp import M2dp
from pipeline.readers.kitti import read_velodyne
from pipeline.views import m2dp as views
from tests.matching.made import along


def rows(signatures: np.ndarray) -> Rows:
    return along(signatures.astype(np.float32))


LINE = rows(np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]]))
"""Four signatures of two numbers, which lie as far apart as their places do."""
PLACES = np.array([0, 0, 1, 2])


def test_the_nearest_signature_answers_and_its_distance_is_cost_and_novelty() -> None:
    method = M2dp()
    ranking = method.localizer(method.learn(LINE, PLACES, Progress()))(
        rows(np.array([[2.2, 0], [0, 5]])), 3
    )
    # From (2.2, 0): row 2 at 0.2, row 3 at 0.8, row 1 at 1.2. From (0, 5): rows 0, 1, 2 at 5, √26,
    # √29.
    np.testing.assert_array_equal(ranking.places, [[1, 2, 0], [0, 0, 1]])
    np.testing.assert_allclose(ranking.costs, [[0.2, 0.8, 1.2], [5, 26**0.5, 29**0.5]], rtol=1e-6)
    np.testing.assert_allclose(ranking.novelty, [[0.2], [5]], rtol=1e-6)
    np.testing.assert_array_equal(ranking.xy_m[:, :, 0], [[2, 3, 1], [0, 1, 2]])
    assert np.isnan(ranking.heading_deg).all()


def test_what_training_never_saw_is_rejected_by_the_threshold_of_the_validation_blocks() -> None:
    rng = np.random.default_rng(0)
    n = 200
    # Signatures that change along the path, some 0.7 a row
    path = np.cumsum(rng.normal(0, 0.05, (n, 192)), axis=0)
    training = rows(path)
    again = rows(path + rng.normal(0, 0.01, path.shape))
    method = M2dp(validation_length_m=1.0)  # one row in forty
    places = (
        np.arange(n) + 5
    ) // 10  # rows 20, 60, ... 180 are kept for validation, each in the middle of its place
    model = method.learn(training, places, Progress())
    evidence = NoveltyEvidence.of(model)
    assert (evidence.unseen["distance"] > evidence.seen["distance"]).all()
    # Five blocks, all right, a fifth of the queries unseen: 4 of 4, and one more counted wrong.
    ((threshold, validation_precision),) = Rejection(target_precision=0.8).thresholds(
        model, ("distance",)
    )
    assert validation_precision == pytest.approx(0.8)
    assert threshold > ACCEPT_NOTHING
    ranking = method.localizer(model)(again, 1)
    assert (ranking.places[:, 0] == places).all()
    assert (ranking.novelty < threshold).all()
    assert (method.localizer(model)(rows(path + 1.0), 1).novelty >= threshold).all()


def test_real_scans_find_their_neighbours(real: Path) -> None:
    # Sixteen scans along 13 m of a street, and one of another: the second of each pair finds a scan
    # beside it.
    scans = [
        read_velodyne(path) for path in sorted((real / "kitti/sequences/00/velodyne").glob("*.bin"))
    ]
    signatures = np.stack([views.M2dp()(scan) for scan in scans])
    elsewhere = views.M2dp()(read_velodyne(real / "kitti/pairs/08/000720.bin"))
    method = M2dp()
    localize = method.localizer(method.learn(rows(signatures[::2]), np.arange(8), Progress()))
    ranking = localize(rows(np.concatenate([signatures[1:15:2], elsewhere[None]])), 1)
    beside = np.abs(ranking.places[:7, 0] - (np.arange(7) + 0.5))
    assert (beside < 2).all()
    assert ranking.novelty[7, 0] > ranking.novelty[:7, 0].max()
