"""Tests of the caveats about a score: one answer to all queries, a site within the tolerance,
thresholds that reject all or nothing."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.evaluation.caveats import BLIND, DEGENERATE, blind, caveats, unsuited
from pipeline.evaluation.protocols import Distance
from pipeline.matching.rejection import ACCEPT_NOTHING
from tests.artifacts import SUITED
from tests.views.made import ALONG, artifacts

NOVELTY = np.linspace(0, 1, 40)
MANY = np.arange(40)


def test_what_one_answer_to_all_would_reach() -> None:
    # By cells place 1 is right for two of the three seen; by distance 10 m is within 15 m of three
    # of the four near ones.
    xy_m = np.array([[0.0, 0], [10, 0], [20, 0], [90, 0], [200, 0]])
    result = blind(np.array([1, 1, 2, -1, -1]), np.array([0, 1, 2, 3, 100.0]), xy_m, Distance())
    assert result == {"cells": 2 / 3, "distance": 3 / 4}
    nothing = blind(np.array([-1]), np.array([100.0]), xy_m[:1], Distance())
    assert np.isnan([*nothing.values()]).all()


@pytest.mark.parametrize(
    ("change", "applies"),
    [
        ({}, {}),
        ({"blind_recall": 0.5}, {DEGENERATE: 1}),
        (
            {"blind_recall": np.nan, "seen_count": 0, "block_count": 0},
            {DEGENERATE: 1, "caveat_few_seen": 0, "caveat_few_blocks": 0},
        ),
        ({"answers": np.minimum(MANY, 21)}, {}),
        ({"answers": np.minimum(MANY, 20)}, {"caveat_one_answer": 0.5}),
        ({"seen_count": 30}, {"caveat_few_seen": 30}),
        ({"block_count": 5}, {"caveat_few_blocks": 5}),
        ({"reject_from": -0.1}, {"caveat_all_rejected": 1}),
        ({"reject_from": 1.1}, {"caveat_none_rejected": 1}),
        ({"reject_from": ACCEPT_NOTHING}, {"caveat_no_threshold": 1}),
        ({"validation_precision": 0.731}, {"caveat_less_precise": 0.731}),
        ({"validation_precision": np.nan}, {}),
    ],
)
def test_a_caveat_is_there_where_it_applies(change: dict, applies: dict) -> None:
    usual = {
        "blind_recall": 0.1,
        "answers": MANY,
        "novelty": NOVELTY,
        "reject_from": 0.5,
        "validation_precision": 0.9,
        "target_precision": 0.9,
    }
    usual |= {"seen_count": 31, "block_count": 6}
    result = caveats(**usual | change)
    assert result.pop(BLIND) == pytest.approx((usual | change)["blind_recall"], nan_ok=True)
    assert result == applies


@pytest.mark.parametrize(
    ("appearance", "left_out", "applies"),
    [
        ({}, {}, {}),
        ({"azimuth_deg": 180.0}, {}, {"caveat_not_all_round": 180}),
        ({"ground_m": -1.73}, {}, {"caveat_ground": -1.73}),
        ({"ground_m": None, "highest_m": 0.4}, {}, {"caveat_low": 0.4}),  # a level 2-D LiDAR
        ({"azimuth_deg": None, "ground_m": None, "highest_m": None}, {}, {}),  # no point at all
        ({}, {"window not yet whole": 3}, {"caveat_windows": 0.5}),  # three submaps are there
        ({}, {"window not yet whole": 2, "no true pose": 1}, {}),
    ],
)
def test_submaps_that_do_not_suit_the_views(
    tmp_path: Path, appearance: dict, left_out: dict, applies: dict
) -> None:
    _, submaps = artifacts(
        tmp_path, [np.eye(3)] * 3, ALONG, appearance=SUITED | appearance, left_out=left_out
    )
    assert unsuited(submaps) == applies
