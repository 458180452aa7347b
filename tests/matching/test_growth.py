"""Days that are learned in their order, on scenes 2 m apart along x."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.growth import grown, in_order
from tests.lifelong.test_steps import DAYS, NONE
from tests.methods.test_scan_context import FIFTY


def test_later_days_are_learned_after_the_first() -> None:
    first, second = DAYS.values()
    (known, _), (later, _) = in_order([first, second], NONE)
    model = FIFTY.learn(*known, Progress())
    found, both = grown(FIFTY, model, [first, second], NONE, Progress())
    assert np.array_equal(both.places, np.concatenate([known.places, later.places]))
    assert np.array_equal(found["database/places"], both.places)
    assert (known.places.max(), later.places.max()) == (11, 17)


def test_a_model_that_knows_the_only_day_is_refused() -> None:
    with pytest.raises(InputError, match="knows the only sequence already"):
        grown(FIFTY, {}, [DAYS["first"]], NONE, Progress())
