"""The style of figures: where headings and names stand, and colours that mean a model."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist

from pipeline.core.errors import InputError
from pipeline.report.figures.panels import Line, balanced, name_ends, share_limits
from pipeline.report.figures.style import colour, figure, folded, line_styles, save
from pipeline.studies.colours import PALETTE

XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
LUMINANCE = XYZ[1]
DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
"""Of linear sRGB, at full severity (Machado, Oliveira and Fernandes, 2009)."""


def test_simulated_stands_above_the_heading_of_a_narrow_figure(tmp_path: Path) -> None:
    wide = figure(7.0, 2.0, "heading")
    narrow = figure(3.0, 2.0, "heading")
    for fig in (wide, narrow):
        fig.add_subplot()
        save(fig, tmp_path / "a.svg", True)
    tops = [[text.get_position()[1] for text in fig.texts] for fig in (wide, narrow)]
    assert tops == [pytest.approx([0.98, 0.98]), pytest.approx([0.98 - 0.17 / 2, 0.98])]


def test_a_figure_is_saved_as_svg_alone(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.pdf: a figure is saved as \.svg"):
        save(figure(3.0, 2.0, "heading"), tmp_path / "a.pdf", False)


def test_colours_stay_apart_to_a_colour_blind_reader_and_can_be_text() -> None:
    srgb = np.array([[int(one[i : i + 2], 16) / 255 for i in (1, 3, 5)] for one in PALETTE])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert (1.05 / (linear @ LUMINANCE + 0.05)).min() >= 4.5  # WCAG 2.2, against white
    xyz = np.clip(linear @ DEUTERANOPIA.T, 0, 1) @ XYZ.T / (XYZ @ np.ones(3))
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    lab = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)
    assert pdist(lab).min() >= 20


def test_a_variant_has_its_methods_colour_darker_and_another_dash() -> None:
    styles = line_styles(["sci-4way", "m2dp", "sci"])
    assert list(styles) == ["sci-4way", "m2dp", "sci"]
    assert styles["sci"] == {"color": colour("sci"), "ls": "-"}
    assert styles["m2dp"] == {"color": colour("m2dp"), "ls": "-"}
    assert styles["sci-4way"]["color"] == "#001A36"  # 0.4 of 00, 40 and 87
    assert styles["sci-4way"]["ls"] != "-"
    assert colour("sci-4way") == colour("sci")


@pytest.mark.parametrize(
    ("number", "grid"),
    [(1, (1, 1)), (5, (1, 5)), (6, (2, 3)), (7, (2, 4)), (10, (2, 5)), (11, (3, 4))],
)
def test_panels_leave_few_cells_empty(number: int, grid: tuple[int, int]) -> None:
    assert balanced(number, 5) == grid


def test_an_axis_of_shares_begins_at_the_tenth_below_and_ends_above_one() -> None:
    assert share_limits([0.47, np.nan], 0.8) == pytest.approx((0.4 - 0.02 * 0.6, 1 + 0.03 * 0.6))
    assert share_limits([np.nan]) == pytest.approx((0.898, 1.003))


def test_names_at_the_end_stand_apart_below_the_top_and_at_the_last_value_there_is() -> None:
    # Four of them crowd at the top; 0.2 keeps its place, though its last value is missing; a line
    # of nothing has no name.
    axis = Figure().subplots()
    axis.set_ylim(0, 1)
    lines = [
        Line(str(end), (0.0, 1.0), [end, end], {"color": "k"})
        for end in (0.95, 0.98, 0.2, 1.0, 0.9, np.nan)
    ]
    lines[2].y[1] = np.nan
    name_ends(axis, lines, gap=0.1)
    found = {text.get_text(): text.xy[1] for text in axis.texts}
    assert found == pytest.approx({"0.9": 0.7, "0.95": 0.8, "0.98": 0.9, "1.0": 1.0, "0.2": 0.2})


def test_a_long_name_is_folded() -> None:
    assert [folded(name) for name in ("sci", "scan_context_all", "pointnetvlad-4way")] == [
        *("sci", "scan_context\n_all", "pointnetvlad\n-4way")
    ]
