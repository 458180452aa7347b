"""KITTI's rows of twelve numbers."""

import numpy as np

from pipeline.formats.kitti import matrix


def test_twelve_numbers_are_three_rows_of_a_pose() -> None:
    found = matrix(np.arange(24.0).reshape(2, 12))
    np.testing.assert_array_equal(found[1], [[12, 13, 14, 15], [16, 17, 18, 19], [20, 21, 22, 23], [0, 0, 0, 1]])
