"""The section on real changes: what it claims it has seen enough for."""

from pathlib import Path

import numpy as np
from matplotlib.text import Text

from pipeline.evaluation.events import Banded, Bands
from pipeline.formats.changes import Change
from pipeline.reports import events
from pipeline.reports.events_figures import SHOWN, TO_COME, by_distance
from pipeline.reports.section import Section
from pipeline.reports.style import SIMULATED, save
from tests.reports.made import BOOTSTRAP, RESULTS

BUILT, GONE = Change("construction", 10, 120, 10.0, 0.0), Change("demolition", 60, 60, 40.0, 110.0)
CHANGES = {"2012-02-04": [BUILT], "2012-03-17": [BUILT, GONE]}
BANDS = Bands((25.0,), few=2)


def told(values: tuple[float, float, float], seen: int = 50) -> Banded:
    """Two bands, the nearer with one number and interval for all NUMBERS."""
    every = np.array([[values] * 3, [(0.9, 0.8, 0.95)] * 3])
    return Banded(np.array([seen, 500]), np.array([5, 50]), every)


def nearby(shown: Banded, to_come: Banded) -> events.Nearby:
    return {
        ("sci", protocol, when): one for protocol in ("cells", "distance") for when, one in ((SHOWN, shown), (TO_COME, to_come))
    }


def test_a_section_counts_changes_and_the_queries_near_them(tmp_path: Path) -> None:
    # Queries at x = 0, 10, 20, 30, 40 are seen. Of them 4 are within 25 m of the construction at x = 10 on each day; the
    # demolition is near the two unseen ones alone.
    section = events.section(tmp_path, "campus-events", RESULTS, CHANGES, BANDS, BOOTSTRAP, True, ["artifacts/events"], {"a": 1})
    section.write(tmp_path)
    assert Section.read(tmp_path) == section
    assert (
        "1 construction and 1 demolition show in the test sequences, and 8 seen queries lie within 25 m of one" in section.prose()
    )
    assert "too few seen queries near changes" in section.prose()  # no seen query is near one to come
    caption, table = section.tables[0]
    assert caption == "recall@1, by cells"
    assert table.header == ("nearest change", "0–25 m", "over 25 m")
    # sci, near: right, right, wrong, wrong of each sequence; far: the fifth, right
    assert [row[0] for row in table.rows] == ["sci", "m2dp", "oracle", "seen queries", "unseen queries"]
    assert [cell[:5] for cell in table.rows[0][1:]] == ["0.500", "1.000"]
    assert table.rows[3] == ("seen queries", "8", "2")
    assert table.rows[4] == ("unseen queries", "2", "2")
    assert section.parameters == {"a": 1, "bands.edges_m": [25.0], "bands.kinds": ["construction", "demolition"], "bands.few": 2}


def test_a_fall_is_sure_where_the_intervals_are_apart() -> None:
    apart = events.compared(nearby(told((0.2, 0.1, 0.3)), told((0.7, 0.6, 0.8))), ["sci"], "recall_at_1", Bands((25.0,)))
    assert apart == (
        "recall@1, by cells, 0–25 m away (50 and 50 seen queries): surely lower where a change shows than where one is to come"
        " for `sci` 0.200 [.10, .30] against 0.700."
    )
    meet = events.compared(nearby(told((0.2, 0.1, 0.65)), told((0.7, 0.6, 0.8))), ["sci"], "recall_at_1", Bands((25.0,)))
    assert meet.endswith("not surely lower for `sci` 0.200 against 0.700.")


def test_of_too_few_queries_nothing_is_claimed() -> None:
    few = events.compared(nearby(told((0.2, 0.1, 0.3), 29), told((0.7, 0.6, 0.8))), ["sci"], "recall_at_1", Bands((25.0,)))
    assert few == "recall@1: too few seen queries near changes, or near those to come, to say anything."


def test_where_nothing_changed_the_section_says_so(tmp_path: Path) -> None:
    nothing = dict.fromkeys(CHANGES, ())
    section = events.section(tmp_path, "campus-events", RESULTS, nothing, BANDS, BOOTSTRAP, False, [], {})
    assert "0 constructions and 0 demolitions show in the test sequences, and 0 seen queries" in section.prose()


def test_the_figure_pales_what_is_of_few_and_is_the_same_each_time(tmp_path: Path) -> None:
    some = nearby(told((0.2, 0.1, 0.3), 29), told((0.7, 0.6, 0.8)))
    fig = by_distance(some, ["0–25 m", "over 25 m"], 30, True)
    shades = {float(np.asarray(line.get_ydata())[0]): line.get_alpha() for line in fig.axes[0].lines}
    assert shades[0.2] == 0.3
    assert (shades[0.7], shades[0.9]) == (1.0, 1.0)
    said = [text.get_text() for text in fig.findobj(Text)]
    assert {SIMULATED, "recall@1, by cells", "exact AUC, by distance"} <= set(said)
    for name in ("a", "b"):
        save(by_distance(some, ["0–25 m", "over 25 m"], 30, True), tmp_path / f"{name}.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
