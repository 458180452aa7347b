"""Tests of the verdict of 3-D maps: usual until a drive teaches it."""

import numpy as np
import pytest

from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.map_verdict import USUAL_THRESHOLDS, calibrated, usual_verdict
from pipeline.posing.probabilities import USUAL
from tests.posing.test_verdict import evidence


def test_a_map_without_a_drive_has_the_usual_probabilities_and_says_so() -> None:
    verdict = usual_verdict()
    assert verdict.pose == USUAL
    assert verdict.reachable == verdict.usual == (0.95, 0.99)
    assert verdict.thresholds[0.95][0] == pytest.approx(0.05)
    assert verdict.validation_blocks == 0


def test_a_short_drive_keeps_the_usual_thresholds_and_learns_the_probabilities() -> None:
    """10 blocks, 8 of them seen, reach no target precision: .95 takes 20 accepted queries."""
    verdict = calibrated(evidence(10))
    assert verdict.usual == (0.95, 0.99)
    assert verdict.claim_thresholds == USUAL_THRESHOLDS
    assert verdict.validation_blocks == 10
    assert verdict.pose != USUAL


def test_a_longer_drive_learns_the_thresholds_that_its_blocks_suffice_for() -> None:
    """Of 100 blocks 80 are seen: enough for .95, which takes 20, not for .99, which takes 100."""
    verdict = calibrated(evidence(100))
    assert verdict.usual == (0.99,)
    assert verdict.reachable == (0.95, 0.99)
    assert verdict.claim_thresholds["fix"][0] > USUAL_THRESHOLDS["fix"][0]
    assert verdict.claim_thresholds["fix"][1] == USUAL_THRESHOLDS["fix"][1]


def test_a_drive_that_contradicts_the_usual_thresholds_lowers_them() -> None:
    """Half of the novel places look as right as the seen ones: they count .2 of 10 blocks, so 1 of
    9 accepted is wrong, more than .95 allows."""
    verdict = calibrated(evidence(10, wrong=5))
    accepted = np.array(verdict.claim_thresholds["fix"])
    assert (accepted <= np.array(USUAL_THRESHOLDS["fix"])).all()
    assert verdict.claim_thresholds["fix"][2] == ACCEPT_NOTHING
