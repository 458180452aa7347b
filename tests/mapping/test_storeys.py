"""Tests how floors above each other are found in a 3-D map."""

import numpy as np
import pytest

from pipeline.mapping.local_ground import LocalGround
from pipeline.mapping.storeys import Storeys, storeys
from pipeline.mapping.tiled_map import Thinning
from tests.inspection.made_maps import Points, floor, house, yard


def found(points_m: Points) -> Storeys:
    thinning = Thinning(0.4)
    thinning.add(points_m)
    tiled = thinning.tiled()
    return storeys(tiled.tiles_m(), LocalGround.of(tiled.tiles_m()))


def test_a_yard_and_a_house_of_one_storey_with_its_ceiling_have_one_floor() -> None:
    # 60 × 60 m are 36 cells of 10 m
    for points_m in (yard(), house(1)):
        assert found(points_m)[:2] == (36, 0)


@pytest.mark.parametrize("storey_m", [2.8, 3.2, 4.8])
def test_two_storeys_are_found_with_their_distance(storey_m: float) -> None:
    cells, above, apart_m = found(house(2, storey_m))
    assert (cells, above) == (36, 36)
    assert apart_m == pytest.approx(storey_m, abs=0.4)  # a level


def test_a_second_storey_on_a_part_of_the_house_counts_there() -> None:
    upper = house(2)
    points_m = np.concatenate([house(1), upper[upper[:, 0] < 20]])
    # 2 of 6 columns of cells
    assert found(points_m)[:2] == (36, 12)


def test_a_roof_over_which_nothing_stands_is_no_storey() -> None:
    assert found(np.concatenate([yard(), floor(6.0)])).above == 0
