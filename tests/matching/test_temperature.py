"""Temperature scaling: how over-confident a network is, and when the views cannot tell."""

import numpy as np
from scipy.special import softmax

from pipeline.matching.temperature import determines_temperature, fit_temperature


def test_logits_blown_up_by_a_factor_are_cooled_by_it() -> None:
    # Classes drawn from the very probabilities that the logits say are calibrated at T = 1, and at
    # T = 3 once tripled.
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 2, (4000, 10))
    classes = np.array([rng.choice(10, p=p) for p in softmax(logits, axis=1)])
    assert abs(fit_temperature(logits, classes) - 1) < 0.08
    assert abs(fit_temperature(3 * logits, classes) / 3 - 1) < 0.08


def test_a_temperature_is_not_determined_where_all_rows_are_right_or_all_wrong_or_none() -> None:
    """The best temperature is then 0 or infinite; one wrong row among right ones determines it."""
    logits = np.array([[2.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 1.0, 3.0]])
    for classes, is_determined in (([0, 1, 2], False), ([2, 2, 0], False), ([0, 0, 2], True)):
        found = fit_temperature(logits, np.array(classes))
        assert determines_temperature(found, logits, np.array(classes)) == is_determined
    assert not determines_temperature(1.0, np.empty((0, 5)), np.empty(0, np.int64))


def test_a_forgotten_class_has_no_say_and_no_rows_leave_the_logits_as_they_are() -> None:
    logits = np.array([[2.0, 1.0, -np.inf], [0.5, 1.0, -np.inf]])
    assert fit_temperature(logits, np.array([0, 0])) == fit_temperature(
        logits[:, :2], np.array([0, 0])
    )
    assert fit_temperature(np.empty((0, 5)), np.empty(0, np.int64)) == 1.0
