"""The report on paper 2's protocol: figures that show what was judged, tables by hand, and the caveats."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.errors import InputError
from pipeline.evaluation.viewpoints import Judged
from pipeline.reports import viewpoint_figures, viewpoint_learning, viewpoints
from pipeline.reports.learned import Learned
from pipeline.reports.style import SIMULATED, colour, save
from pipeline.reports.viewpoint_tables import after_learning, every_heading, over_headings, over_seeds
from tests.reports.viewed import judged

RIGHT, HALF, WRONG = np.ones(4, bool), np.array([1, 0, 1, 0], bool), np.zeros(4, bool)
SCORE = np.array([4.0, 3.0, 2.0, 1.0])
# ROC-AUC of HALF by SCORE: of the pairs right over wrong 4>3, 4>1 and 2>1 hold and 2>3 does not: 3/4.
# PR: precision 1, 1, 1/2, 2/3, 1/2 at recall 0, 1/2, 1/2, 1, 1: area 1/2 + (1/2 + 2/3)/4 = 19/24 = .792.


def at(*correct: np.ndarray) -> Judged:
    """Four queries from each of some headings."""
    return judged(np.stack(correct), np.tile(SCORE, (len(correct), 1)))


RESULTS = {
    ("pfl", "a"): [at(RIGHT, HALF), at(HALF, HALF)],  # accuracies .75 and .5 over the headings
    ("sad", "a"): [at(WRONG, HALF)],
    ("pfl", "b"): [at(RIGHT, RIGHT)],
}
CURVES = {"code_variance": np.array([0.4, 0.1]), "code_distance": np.array([8.0, 2.0]), "held_out_error": np.array([0.5, 0.25])}
MODELS = {
    "pfl": [Learned({}, CURVES, 0), Learned({}, {k: 3 * v for k, v in CURVES.items()}, None)],
    "sad": [Learned({}, {}, None)],
}
SEEN = np.zeros((16, 4, 4), np.uint8)
SEEN[:, 0, 0] = np.arange(16)
PICTURES = {"pfl": (SEEN, SEEN), "afl": (SEEN, np.full_like(SEEN, 255))}
FIGURES: dict[str, Callable[[bool], Figure | None]] = {
    "precision_recall": lambda simulated: viewpoint_figures.precision_recall(group("a"), "a", simulated),
    "indices": lambda simulated: viewpoint_figures.indices(RESULTS, simulated),
    "reconstructions": lambda simulated: viewpoint_learning.reconstructions(PICTURES, simulated),
    "collapse": lambda simulated: viewpoint_learning.collapse(curves(), simulated),
}


def group(sequence: str) -> dict[str, Sequence[Judged]]:
    return {method: seeds for (method, where), seeds in RESULTS.items() if where == sequence}


def curves() -> dict[str, list[dict[str, np.ndarray]]]:
    return {method: [dict(one.curves) for one in seeds] for method, seeds in MODELS.items()}


def drawn(name: str) -> Figure:
    figure = FIGURES[name](False)
    assert figure is not None
    return figure


def words(fig: Figure | Axes) -> list[str]:
    return [text.get_text() for text in fig.findobj(Text)]


def lines(axis: Axes, method: str) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in axis.lines if to_hex(line.get_color()).upper() == colour(method)]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_simulated_data_says_so_and_is_the_same_file_each_time(name: str, tmp_path: Path) -> None:
    simulated, recorded, again = (FIGURES[name](flag) for flag in (True, False, True))
    assert simulated is not None
    assert recorded is not None
    assert again is not None
    assert SIMULATED in words(simulated)
    assert SIMULATED not in words(recorded)
    assert save(simulated, tmp_path / "a.svg").read_bytes() == save(again, tmp_path / "b.svg").read_bytes()


def test_curves_have_a_panel_a_heading_a_line_a_seed_and_the_accuracy_in_words() -> None:
    first, second = drawn("precision_recall").axes
    assert (first.get_title(), second.get_title()) == ("90°", "270°")  # two headings: half way between 0° and 180°
    assert lines(second, "sad")[0] == pytest.approx(np.array([[0, 1], [0.5, 1], [0.5, 0.5], [1, 2 / 3], [1, 0.5]]))
    assert len(lines(second, "pfl")) == 2
    assert not lines(first, "sad")  # without a correct match recall is of nothing
    sad, pfl = first.texts
    assert (sad.get_text(), pfl.get_text()) == ("0.000", "0.750")  # pfl: (1 + 1/2)/2 over its seeds
    assert sad.xyann < pfl.xyann  # in the legend's order
    assert sad.get_ha() == "left"


def test_the_accuracies_of_poor_methods_stand_where_no_curve_is() -> None:
    fig = viewpoint_figures.precision_recall({"pfl": [at(HALF)], "sad": [at(WRONG)]}, "a", False)
    pfl, sad = fig.axes[0].texts
    assert (pfl.get_text(), sad.get_text(), pfl.get_ha()) == ("0.500", "0.000", "right")
    assert sad.xyann < pfl.xyann
    assert [text.get_text() for text in drawn("precision_recall").legends[0].get_texts()] == ["pfl", "sad"]


def test_each_index_is_the_mean_over_sequences_and_seeds_and_a_missing_one_a_gap() -> None:
    roc, pr, accuracy, recall = drawn("indices").axes
    assert [axis.get_title() for axis in (roc, accuracy)] == ["ROC-AUC, the paper's index", "accuracy within 10 m"]
    (pfl,) = lines(accuracy, "pfl")
    assert pfl[:, 1] == pytest.approx([(1 + 1 / 2 + 1) / 3, (1 / 2 + 1 / 2 + 1) / 3])
    assert len(accuracy.collections[0].get_offsets()) == 6  # three judgements at two headings
    (sad,) = lines(roc, "sad")
    assert sad[:, 1].tolist() == [pytest.approx(np.nan, nan_ok=True), 0.75]
    assert lines(pr, "sad")[0][1, 1] == pytest.approx(19 / 24)
    assert lines(recall, "sad")[0][:, 1].tolist() == [0.0, 0.25]  # one of four, before the wrong one that comes second
    assert pfl[0, 0] < lines(accuracy, "sad")[0][0, 0]  # side by side
    assert [text.get_text() for text in roc.get_xticklabels()] == ["90°", "270°"]


def test_indices_of_which_none_is_there_can_be_drawn() -> None:
    nobody = at(RIGHT, RIGHT)
    assert len(viewpoint_figures.indices({("pfl", "a"): [nobody]}, False).axes) == 4


def test_reconstructions_stand_below_what_was_seen_at_every_other_heading_with_their_error() -> None:
    axes = np.reshape(drawn("reconstructions").axes, (3, 8))
    assert [axis.get_title() for axis in axes[0]] == ["0°", "45°", "90°", "135°", "180°", "225°", "270°", "315°"]
    assert [axis.images[0].get_array()[0, 0] for axis in axes[0]] == list(range(0, 16, 2))
    assert [line[0].get_ylabel() for line in axes] == ["seen", "pfl", "afl"]
    assert {axis.get_xlabel() for axis in axes[1]} == {"0.000"}
    # All white of black but for one of sixteen pixels, 0 to 14 of 255: (255/127.5)² = 4, and ((255 − 14)/127.5)²/16 + 4·15/16.
    assert (axes[2, 0].get_xlabel(), axes[2, 7].get_xlabel()) == ("4.000", f"{(241 / 127.5) ** 2 / 16 + 3.75:.3f}")


def test_reconstructions_of_other_images_stand_below_their_own() -> None:
    first, second = (SEEN[:3], SEEN[:3]), (SEEN[3:6], SEEN[3:6])
    fig = viewpoint_learning.reconstructions({"pfl": first, "afl": second, "sad": second}, False)
    assert [axis.get_ylabel() for axis in fig.axes[::3]] == ["seen", "pfl", "seen", "afl", "sad"]


def test_collapse_is_shown_by_a_line_a_seed_of_the_methods_that_tell() -> None:
    variance, distance, error = drawn("collapse").axes
    assert [line[:, 1].tolist() for line in lines(variance, "pfl")] == [[0.4, 0.1], pytest.approx([1.2, 0.3])]
    assert lines(distance, "pfl")[0].tolist() == [[1, 8.0], [2, 2.0]]
    assert lines(error, "pfl")[0][:, 1].tolist() == [0.5, 0.25]
    assert "sad" not in words(drawn("collapse"))
    assert viewpoint_learning.collapse({"sad": [{}]}, False) is None


def test_the_table_has_means_over_the_headings_then_over_the_sequences() -> None:
    table = over_headings(RESULTS)
    rows = {row[:2]: row[2:] for row in table.rows}
    # pfl on a: seeds' mean .75 at the first heading, .5 at the second. Its ROC-AUC is .75 at both: one seed's first has none.
    assert rows["a", "pfl"] == ("0.750 ± .000", "0.844 ± .074", "0.625 ± .177", "0.438 ± .265", "2 of 2", "4", "8224")
    assert rows["a", "sad"] == ("0.750", "0.792", "0.250 ± .354", "0.125 ± .177", "1 of 2", "4", "8224")
    assert rows["b", "pfl"] == ("–", "1.000 ± .000", "1.000 ± .000", "1.000 ± .000", "0 of 2", "4", "8224")
    assert rows["all, ± over sequences", "pfl"][2] == "0.812 ± .265"  # of .625 and 1
    assert rows["all, ± over sequences", "sad"][2] == "0.250"
    assert len(over_headings({("sad", "a"): RESULTS["sad", "a"]}).rows) == 1


def test_seeds_are_told_where_there_are_several() -> None:
    table = over_seeds(RESULTS)
    assert table is not None
    assert table.rows == (("a", "pfl", "2", "0.750 ± .000", "0.844 ± .074", "0.625 ± .177", "0.438 ± .265"),)
    assert over_seeds({("sad", "a"): RESULTS["sad", "a"]}) is None


def test_every_heading_has_a_column() -> None:
    table = every_heading(RESULTS, "accuracy")
    assert table.header == ("sequence", "method", "90°", "270°")
    assert table.rows[0] == ("a", "pfl", "0.750 ± .354", "0.500 ± .000")
    assert every_heading(RESULTS, "roc_auc").rows[2] == ("b", "pfl", "–", "–")


def test_what_was_learned_is_told_at_the_round_that_was_kept() -> None:
    # The first model kept round 0 (.4, 8, .5), the other does not say, so its last counts (.3, 6, .75).
    table = after_learning(MODELS)
    assert table is not None
    assert table.rows == (("pfl", "0.350 ± .071", "7.00 ± 1.41", "0.625 ± .177"),)
    assert after_learning({"sad": MODELS["sad"]}) is None


def test_the_page_shows_every_figure_and_says_what_a_reader_must_know(tmp_path: Path) -> None:
    written = viewpoints.write(tmp_path / "new", "campus", True, RESULTS, MODELS, PICTURES)
    page, table, *figures = written
    text = page.read_text()
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(path.name for path in written)
    assert re.findall(r"\]\((\S+\.svg)\)", text) == [path.name for path in figures]
    assert [path.stem for path in figures] == [
        "viewpoints_precision_recall_a",
        "viewpoints_precision_recall_b",
        "viewpoints_indices",
        "viewpoints_reconstructions",
        "viewpoints_collapse",
    ]
    flat = " ".join(text.split())
    for caveat in (
        "**Simulated, not recorded data.**",
        "recall is of the method's own correct matches",
        "Not to be compared with the published bars.",
        "drawn every 180° from the robot's own heading on",
        "half way between: 90°, 270° and so on",
        "**correct** within 10 m",
        "a whole window of 10 steps",
    ):
        assert caveat in flat
    assert over_headings(RESULTS).markdown() in text
    assert over_headings(RESULTS).text() in table.read_text()
    assert table.read_text().startswith("simulated campus")
    assert "Heading by heading" in text


def test_a_sequence_has_curves_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    draw = viewpoint_figures.precision_recall
    monkeypatch.setattr(viewpoint_figures, "precision_recall", lambda *args: asked.append(args[:2]) or draw(*args))
    viewpoints.write(tmp_path, "campus", True, RESULTS, {}, {})
    assert asked == [(group("a"), "a"), (group("b"), "b")]


def test_one_judgement_and_model_need_no_list_and_recorded_data_no_caveat(tmp_path: Path) -> None:
    written = viewpoints.write(tmp_path, "kitti", False, {("sad", "00"): at(WRONG, HALF)}, {"sad": MODELS["sad"][0]}, {})
    drawn = ["viewpoints_precision_recall_00.svg", "viewpoints_indices.svg"]
    assert [path.name for path in written] == ["viewpoints.md", "viewpoints.txt", *drawn]
    text = written[0].read_text() + written[1].read_text()
    assert "imulated" not in text
    assert "over seeds" not in text
    assert "What was learned" not in text


def test_a_report_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one judged sequence"):
        viewpoints.write(tmp_path, "campus", True, {}, {}, {})
