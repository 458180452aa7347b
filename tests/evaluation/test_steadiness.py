"""Tests of AwC-FT: the area between the best and the worst day's F1, worked out by hand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.judge import judge
from pipeline.evaluation.protocols import PROTOCOLS, Distance
from pipeline.evaluation.steadiness import awc_ft
from tests.evaluation.made import BOOTSTRAP, LABELS, SCI, XY_M, rows, standing

RIGHT, WRONG, UNSEEN = (0, 1, 4), 2, 6
"""Queries of SCI: three that are right by both protocols, one that is wrong, and an unseen one."""


def day(queries: Sequence[int], novelty: Sequence[float]) -> Evaluation:
    """A day of these queries of SCI, with novelties of one kind."""
    index = list(queries)
    ranking = replace(
        rows(SCI, index), novelty=np.array(novelty, np.float32)[:, None], kinds=("entropy",)
    )
    labels = rows(LABELS, index)
    return judge(ranking, (0.5,), labels, standing(XY_M[index]), Distance(), BOOTSTRAP)


FIRST = day(RIGHT, [0.0, 0.2, 1.0])
SECOND = day((WRONG, *RIGHT[:2]), [0.0, 0.4, 0.6])


def test_the_area_between_the_curves_of_two_days_is_that_of_methods_2_7() -> None:
    # F1 = 2 TP / (2 TP + FP + FN), where FN by distance are all seen queries that are not TP. First
    # day: .5 above 0, .8 above .2. Second day by distance: 0 above 0, 1/(1.5 + 1) = .4 above .4, 2/3
    # above .6; by cells FN are the rejected alone: 0, then 2/(2 + 1 + 1) = .5, then 4/(4 + 1) = .8.
    by_distance = 0.2 * 0.5 + 0.2 * 0.8 + 0.2 * 0.4 + 0.4 * (0.8 - 2 / 3)
    by_cells = 0.2 * 0.5 + 0.2 * 0.8 + 0.2 * 0.3 + 0.4 * 0.0
    assert awc_ft([FIRST, SECOND], "distance") == pytest.approx(by_distance)
    assert awc_ft([SECOND, FIRST], "cells") == pytest.approx(by_cells)


def test_a_third_day_between_the_two_changes_nothing() -> None:
    # All right as on the first day, but later: F1 is 0 up to .2, .5 above .2, .8 above .4, 1 above
    # .6. It is the best day above .6 (1 against .667), and never the worst but up to .2 (0, as the
    # second day).
    third = day(RIGHT, [0.2, 0.4, 0.6])
    area = 0.2 * 0.5 + 0.2 * 0.8 + 0.2 * 0.4 + 0.4 * (1 - 2 / 3)
    assert awc_ft([FIRST, SECOND, third], "distance") == pytest.approx(area)


def test_equal_days_have_no_area_whatever_the_unit_of_the_novelty() -> None:
    for protocol in PROTOCOLS:
        assert awc_ft([FIRST, FIRST, FIRST], protocol) == 0.0
        # In tens and from 7 on: the threshold is mapped to 0…1.
        moved = [
            replace(one, novelty=7 + 10 * one.novelty.astype(np.float64)) for one in (FIRST, SECOND)
        ]
        assert awc_ft(moved, protocol) == pytest.approx(awc_ft([FIRST, SECOND], protocol))


def test_an_infinite_novelty_is_never_accepted_and_does_not_stretch_the_range() -> None:
    # The third right query of the first day is lost, which thresholds below 1 never accepted, so
    # the range ends at .6: the step above .6 is gone.
    lost = day(RIGHT, [0.0, 0.2, np.inf])
    area = (0.2 * 0.5 + 0.2 * 0.8 + 0.2 * 0.4) / 0.6
    assert awc_ft([lost, SECOND], "distance") == pytest.approx(area)


def test_fewer_than_two_days_with_a_seen_query_have_no_area() -> None:
    unseen = day((UNSEEN,), [0.9])
    assert np.isnan(awc_ft([], "cells"))
    assert np.isnan(awc_ft([FIRST], "distance"))
    assert np.isnan(awc_ft([FIRST, unseen], "cells"))
    # A day without a seen query does not stretch the range either.
    far = replace(unseen, novelty=np.array([[99.0]], np.float32))
    assert awc_ft([FIRST, far, SECOND], "cells") == awc_ft([FIRST, SECOND], "cells")


def test_one_novelty_for_all_leaves_no_threshold_to_run_over() -> None:
    same = day(RIGHT, [0.5, 0.5, 0.5])
    assert np.isnan(awc_ft([same, same], "distance"))
