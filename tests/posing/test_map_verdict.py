"""Tests of the verdict of 3-D maps: usual until a drive teaches it."""

import numpy as np

from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.map_verdict import USUAL_THRESHOLDS, calibrated, usual_verdict
from pipeline.posing.probabilities import OF_MAPS
from tests.posing.test_verdict import evidence


def test_a_map_without_a_drive_has_the_usual_probabilities_and_says_so() -> None:
    verdict = usual_verdict()
    assert verdict.pose == OF_MAPS
    assert verdict.reachable == verdict.usual == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)
    assert [pose for pose, *_ in verdict.thresholds.values()] == [*2 * [0.05], *4 * [0.01]]
    assert verdict.validation_blocks == 0


def test_a_short_drive_keeps_the_usual_thresholds_and_learns_the_probabilities() -> None:
    """10 blocks, 8 of them seen, reach no target precision: .9 takes 9 accepted queries."""
    verdict = calibrated(evidence(10))
    assert verdict.usual == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)
    assert verdict.claim_thresholds == USUAL_THRESHOLDS
    assert verdict.validation_blocks == 10
    assert verdict.pose != OF_MAPS


def test_a_longer_drive_learns_the_thresholds_that_its_blocks_suffice_for() -> None:
    """Of 100 blocks 80 are seen: enough for .985, which takes 66, not for .99, which takes 99."""
    verdict = calibrated(evidence(100))
    assert verdict.usual == (0.99,)
    assert verdict.reachable == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)
    learned, usual = np.array(verdict.claim_thresholds["fix"]), np.array(USUAL_THRESHOLDS["fix"])
    assert (learned[:5] > usual[:5]).all()
    assert (learned[5:] == usual[5:]).all()


def test_a_drive_that_contradicts_the_usual_thresholds_lowers_them() -> None:
    """Half of the novel places look as right as the seen ones: they count .2 of 10 blocks, so 1 of
    9 accepted is wrong, more than .95 allows."""
    verdict = calibrated(evidence(10, wrong=5))
    accepted = np.array(verdict.claim_thresholds["fix"])
    assert (accepted <= np.array(USUAL_THRESHOLDS["fix"])).all()
    assert (accepted[-2:] == ACCEPT_NOTHING).all()
