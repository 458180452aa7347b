"""The exact curve of precision over recall."""

import pytest

from tests.report.figures.made import ONE


def test_the_exact_curve_passes_every_novelty_and_by_distance_a_misplaced_query_lowers_recall() -> (
    None
):
    # Accepted one by one as novelty rises: right, right, misplaced, misplaced, unseen, right,
    # unseen; 5 are seen.
    precision, recall = ONE[0].evaluation.exact_curve("cells")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 2 / 4, 2 / 5, 3 / 6, 3 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 4, 2 / 3, 2 / 3, 1, 1])
    # By distance the second misplaced one is right, 6 m away; recall is of all five seen.
    precision, recall = ONE[0].evaluation.exact_curve("distance")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 3 / 4, 3 / 5, 4 / 6, 4 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 5, 3 / 5, 3 / 5, 4 / 5, 4 / 5])
