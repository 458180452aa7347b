"""Incremental learning of a Scan Context model: two days of scenes 2 m apart, learned in their
order."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.incremental import extended, in_order
from tests.lifelong.test_steps import DAYS, NO_PLACES
from tests.methods.test_scan_context import FIFTY


def test_later_days_are_learned_after_the_first() -> None:
    first, second = DAYS.values()
    (first_set, _), (second_set, _) = in_order([first, second], NO_PLACES)
    model = FIFTY.learn(*first_set, Progress())
    model_of_both, learned_set = extended(FIFTY, model, [first, second], NO_PLACES, Progress())
    assert np.array_equal(learned_set.places, np.concatenate([first_set.places, second_set.places]))
    assert np.array_equal(model_of_both["database/places"], learned_set.places)
    assert (first_set.places.max(), second_set.places.max()) == (11, 17)


def test_a_model_that_knows_the_only_day_is_refused() -> None:
    with pytest.raises(InputError, match="knows the only sequence already"):
        extended(FIFTY, {}, [DAYS["first"]], NO_PLACES, Progress())
