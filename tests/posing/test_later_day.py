"""Tests of thresholds that a later day teaches again: what it has blocks for, and what stays."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.posing import covariances
from pipeline.posing.later_day import renewed
from pipeline.posing.verdict import CLAIMS, TARGET_PRECISIONS, Verdict
from tests.posing.scene import OVERLAPS
from tests.posing.test_verdict import evidence

OWN = {0.95: 0.3, 0.99: 0.1, 0.999: -1.0}
"""The thresholds of a site whose own day had blocks enough for .99 alone."""


def verdict(own: dict[float, float] = OWN) -> Verdict:
    """The verdict of a site that learned a drive, by overlap alone."""
    thresholds = dict.fromkeys(CLAIMS, tuple(own.values()))
    return Verdict(OVERLAPS, OVERLAPS, tuple(own), thresholds, 100, 0.2)


def test_a_short_day_keeps_the_thresholds_of_the_site_and_its_models() -> None:
    """8 of 10 blocks are seen: too few for .9, which takes 9. None of the fixes is accepted
    wrongly, so nothing is lowered. .9 was not tried by the site: what keeps .95 keeps it too."""
    after = renewed(verdict(), evidence(10))
    assert after.learned == ()
    assert after.lowered == ()
    assert not after.has_covariances
    assert after.verdict.claim_thresholds["fix"] == (0.3, 0.3, *4 * [0.1], -1, -1)
    assert after.verdict.reachable == TARGET_PRECISIONS[:6]
    assert (after.verdict.pose, after.verdict.place) == (OVERLAPS, OVERLAPS)
    assert after.verdict.validation_blocks == 100
    assert after.verdict.covariances == covariances.USUAL


def test_a_long_day_reaches_target_precisions_that_the_site_could_not() -> None:
    """240 of 300 blocks are seen: enough for .995, which takes 199, not for .999, which takes 999.
    All of them are right, with an error probability of at most 1 / (1 + e) = .27, and the novel
    places have at least .88: so the limit of fifteen times what .995 allows is the threshold."""
    after = renewed(verdict(), evidence(300))
    assert after.learned == TARGET_PRECISIONS[:7]
    assert after.verdict.reachable == TARGET_PRECISIONS[:7]
    assert after.verdict.claim_thresholds["fix"][6] == pytest.approx(0.075)
    assert after.verdict.claim_thresholds["fix"][7] == -1


def test_a_day_that_contradicts_the_site_lowers_its_thresholds() -> None:
    """Every second novel place looks like a right one: 1 of 9 accepted fixes is wrong."""
    after = renewed(verdict({0.95: 0.5, 0.99: 0.3, 0.999: -1.0}), evidence(10, wrong=5))
    fix = np.array(after.verdict.claim_thresholds["fix"])
    assert after.learned == ()
    assert 0.99 in after.lowered
    assert fix[5] < 0.3
    assert (np.diff(fix) <= 0).all()


def test_a_day_may_loosen_a_threshold_only_by_its_own_evidence() -> None:
    """The site accepts hardly anything at .95. 80 of 100 blocks are seen and right, which supports
    more; but .99 takes 99, so the strict threshold of .99 stays."""
    strict = verdict({0.95: 1e-3, 0.99: 1e-4, 0.999: -1.0})
    after = renewed(strict, evidence(100))
    fix = dict(zip(TARGET_PRECISIONS, after.verdict.claim_thresholds["fix"], strict=True))
    assert fix[0.95] > 0.2
    assert fix[0.99] == 1e-4


def test_few_blocks_do_not_lower_a_threshold_that_they_do_not_contradict() -> None:
    """One of 20 novel places is accepted: .2 of 16.2 blocks, less than .05 of them. One more would
    break .9 at the looser thresholds, so .9 alone would be stricter than .95; .95 stays, and what
    keeps .95 keeps .9."""
    own = verdict({0.95: 0.3, 0.999: -1.0})
    after = renewed(own, evidence(20, wrong=1))
    fix = after.verdict.claim_thresholds["fix"]
    assert fix[1] == 0.3
    assert fix[0] >= fix[1]


def test_enough_right_fixes_teach_the_covariances() -> None:
    """80 fixes of a probability of .9 or more are right; with 40 the site's own model stays."""
    own = replace(verdict(), pose=replace(OVERLAPS, offset=OVERLAPS.offset + 5))
    assert renewed(own, evidence(80)).has_covariances
    assert not renewed(own, evidence(40)).has_covariances
