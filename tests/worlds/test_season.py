"""How many leaves are out on a date, and how dense foliage then is."""

from datetime import date

import numpy as np
import pytest

from worlds.driving.day import extinction_per_m, foliage
from worlds.layout.shapes import Species


@pytest.mark.parametrize(
    ("day", "share"),
    [
        (date(2012, 1, 15), 0.0),
        (date(2012, 4, 15), 0.0),
        (date(2012, 5, 26), 41 / 45),  # 41 of the 45 days from 15 April to 30 May
        (date(2012, 8, 20), 1.0),
        # 17 of the 53 days from 22 September to 14 November are left
        (date(2012, 10, 28), 17 / 53),
        (date(2012, 11, 16), 0.0),
        (date(2013, 4, 5), 0.0),
    ],
)
def test_leaves_come_in_spring_and_fall_in_autumn(day: date, share: float):
    assert foliage(day) == pytest.approx(share)


def test_conifers_keep_their_needles_and_bare_trees_may_be_denser():
    species = np.array([Species.DECIDUOUS, Species.CONIFER, Species.HEDGE, Species.SOLID])
    winter = date(2012, 1, 15)
    assert extinction_per_m(species, winter) == pytest.approx([0.06, 1.1, 0.5, 0.0])
    assert extinction_per_m(species, winter, 0.15) == pytest.approx([0.15, 1.1, 0.5, 0.0])
    assert extinction_per_m(species, date(2012, 8, 20)) == pytest.approx([0.91, 1.1, 2.0, 0.0])
