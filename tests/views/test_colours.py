"""Heights as colours (METHODS 2.1): Matlab's jet, its clamped index, and halves rounded up."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.views.scan_context import colorize, colours, jet, quantize


@pytest.mark.parametrize(
    ("height_m", "rgb"),
    [
        *((h, (0, 0, 131)) for h in (-1.0, 0.0, 0.02, 0.05)),
        (0.1, (0, 0, 135)),
        (1.0, (0, 0, 195)),
        (3.75, (0, 128, 255)),
        (5.0, (0, 211, 255)),
        (7.5, (128, 255, 128)),
        (10.0, (255, 215, 0)),
        (14.9, (139, 0, 0)),
        *((h, (131, 0, 0)) for h in (15.0, 15.1, 1e6)),
    ],
)
def test_heights_have_the_authors_colours(height_m: float, rgb: tuple[int, int, int]) -> None:
    assert tuple(colorize(np.array([[height_m]], np.float32))[0, 0].tolist()) == rgb


def test_jet_of_255_rises_and_falls_where_matlabs_does() -> None:
    # 1-based: red from 97 to the end, green from 33 to 223, blue to 159; the first entry is (0, 0,
    # 0.515625).
    table = jet(255)
    assert [(int(np.flatnonzero(c)[0]) + 1, int(np.flatnonzero(c)[-1]) + 1) for c in table.T] == [
        (97, 255),
        (33, 223),
        (1, 159),
    ]
    np.testing.assert_array_equal(table[0], [0, 0, 0.515625])


def test_halves_are_rounded_up_and_a_range_may_start_below_the_ground() -> None:
    # Over 0 to 255 m a height is its own shade: 0.5 to 1, 1.5 to 2, 2.5 to 3 (to even would be 2).
    heights = np.array([-3, 0, 0.49, 0.5, 1.5, 2.5, 254.5, 255, 300], np.float32)
    assert quantize(heights, 0.0, 255.0).tolist() == [0, 0, 0, 1, 2, 3, 255, 255, 255]
    # From −5 to 5 m: 0 is the middle, 127.5 rounded up.
    assert quantize(np.array([-5, 0, 5], np.float32), -5.0, 5.0).tolist() == [0, 128, 255]


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (0.0, float("nan"))])
def test_a_range_without_length_is_refused(low: float, high: float) -> None:
    with pytest.raises(InputError):
        quantize(np.zeros(3, np.float32), low, high)


@pytest.mark.parametrize("shape", [(40, 120), (2, 40, 120), (0, 4, 8)])
def test_colours_are_a_last_axis(shape: tuple[int, ...]) -> None:
    image = colorize(np.zeros(shape, np.float32))
    assert image.shape == (*shape, 3)
    assert image.dtype == np.uint8


def test_grey_is_the_shade_itself_and_the_first_two_of_jet_share_a_colour() -> None:
    assert colours("grey").tolist() == [[shade] for shade in range(256)]
    table = colours("jet")
    assert table.shape == (256, 3)
    assert len(np.unique(table, axis=0)) == 255
    assert table[0].tolist() == table[1].tolist()
