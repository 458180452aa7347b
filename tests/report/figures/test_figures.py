"""Every figure by its digest: a change of what it shows is seen, and looked at.

A figure that differs from its snapshot lies as an SVG in the folder that the failure names. If it
is right, `pytest tests/report/figures/test_figures.py --snapshot-update` takes it.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from syrupy.assertion import SnapshotAssertion

from pipeline.core.errors import InputError
from pipeline.evaluation.rows import NEAR_CHANGE, row, table
from pipeline.perturbations.construction import Construction
from pipeline.report.comparison import AUC, AUC_SHARE, HEADING_ERROR, RECALL_BY_DISTANCE
from pipeline.report.figures import (
    ageing,
    curves,
    events,
    lifelong,
    maps,
    matches,
    rejection,
    robustness,
    verdicts,
    viewpoints,
    views,
)
from pipeline.report.figures.style import COORDINATES, SIMULATED, save
from pipeline.report.figures.sweep import response
from pipeline.sweeps.record import Record
from tests.report.figures.made import (
    BOTH,
    BUILT,
    COMPARED,
    NOTHING,
    ONE,
    POSED,
    TRAIN_PLACES,
    TRAIN_XY_M,
    TURNED,
    bounded,
    matched,
    words,
)
from tests.report.figures.test_views import GROUND_M, VIEW, bird_view

NONE = (np.nan,) * 3
NOT_THERE = np.array([np.nan, np.nan])
DAYS = (0.0, 100.0, 200.0, 300.0)
STEPS = ["2012-01-15 1/2", "2012-01-15 2/2"]
LOSSES = {
    "loss": np.array([3.0, 2.0, 2.5]),
    "validation_loss": np.array([3.5, 2.5, 2.7]),
    "validation_recall": np.array([0.1, 0.4, 0.5]),
}
IMAGES = np.zeros((50, 40, 120), np.float32)
IMAGES[:, 0, 0] = np.arange(50)
TRAINING = matches.TrainingViews(IMAGES, TRAIN_PLACES, TRAIN_XY_M)
SIZES = {
    ("sci", "cells", "auc_top1"): [np.array([0.4, 0.6]), np.array([0.5]), np.array([0.9, np.nan])],
    ("m2dp", "cells", "auc_top1"): [np.array([0.4, 0.3]), NOT_THERE, np.array([0.5, 0.2])],
}
ORACLES = {"cells": (0.8, 0.9, 0.9), "distance": (1.0, 1.0, 1.0)}
GROUP = {
    "pfl": [matched("1111", "1010"), matched("1010", "1010")],
    "sad": [matched("0000", "1010")],
}
INDICES = {
    (model, name): np.array([[0.5, 0.9], [0.7, np.nan]])
    for model in ("pfl", "sad")
    for name in viewpoints.INDICES
}
LEARNED = {
    "code_variance": np.array([0.4, 0.1]),
    "code_distance": np.array([8.0, 2.0]),
    "validation_error": np.array([0.5, 0.25]),
    "black_error": np.array([0.125, 0.125]),
}
CURVES = {"pfl": [LEARNED, {name: 3 * curve for name, curve in LEARNED.items()}], "sad": [{}]}
SEEN = np.zeros((16, 4, 4), np.uint8)
SEEN[:, 0, 0] = np.arange(16)
RECALLS = np.array([[0.9, np.nan], [0.35, 1.0]])
OVER_STEPS = {
    title: {
        ("days", "a"): np.array([[0.5, 0.7], [0.7, np.nan]]),
        ("streets", "b"): np.array([[0.2, 0.4]]),
    }
    for title in ("recall", "forgetting")
}
XY_M = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0]])
KNOWN = (XY_M, np.array([1, -1, 0]), STEPS)
FOLLOWED = (
    ageing.FollowedNumber("cells", "auc_top1", "AUC, by cells"),
    ageing.FollowedNumber("distance", "novelty_percentile", "novelty, by distance"),
)


def followed(
    model: str, slope: tuple[float, float, float], values: tuple[float, ...], which: int = 0
) -> list[dict[str, Any]]:
    """Rows of one of FOLLOWED of one model, whose values on the days lie on the fitted line."""
    protocol, number, _ = FOLLOWED[which]
    rows = [{"method": model} | row(f"{number}_per_100_days", protocol, *slope)]
    for days, value in zip(DAYS, values, strict=False):
        place = {"method": model, "sequence": f"day {days:g}", "days": days}
        rows += [place | row(name, protocol, value) for name in (number, f"{number}_line")]
    return rows


AGED = table(
    [
        *followed("sci", (-0.14, -0.2, -0.08), (1.0, 0.9, 0.7, 0.6)),
        *followed("m2dp", (-0.005, -0.1, 0.1), (1.0, 0.9, 0.7, 0.6)),
        *followed("oracle", (0.0, -0.1, 0.1), (1.0, 1.0, 0.9, 0.9)),
        *followed("sci", (1.26, np.nan, np.nan), (50.0, 52.0, 51.0, 54.0), 1),
        *followed("m2dp", NONE, (np.nan,) * 4, 1),
    ]
)


def near_changes() -> Figure:
    """Of 29 seen queries near a change that shows, and of 50 near one to come; 500 are far off."""
    bands = {25.0: "0–25 m", np.inf: "over 25 m"}
    rows = []
    for change, seen, recall in (
        ("shown", 29, (0.2, 0.1, 0.3)),
        ("to come", 50, (0.7, 0.6, 0.8)),
    ):
        for edge_m in bands:
            is_near = edge_m == 25.0
            place = {"method": "sci", "ask": NEAR_CHANGE, "of": change, "at": edge_m}
            for protocol in ("cells", "distance"):
                for name, numbers in (
                    ("seen", (seen if is_near else 500,)),
                    ("unseen", (5 if is_near else 50,)),
                    ("recall_at_1", recall if is_near else (0.9, 0.8, 0.95)),
                    ("auc_exact_top1", NONE if is_near else (0.9, 0.8, 0.95)),
                ):
                    rows.append(place | row(name, protocol, *numbers))
    return events.by_distance(table(rows), ["sci"], bands, 30)


def job(number: int, cell: str, n_way: str, auc: float, error: str | None = None) -> Record:
    rows = [
        *(row("auc_top1", "cells", value) for value in (auc, auc - 0.2, np.nan)),
        row("recall_at_1", "distance", 0.5),
        row("oracle", "cells", 0.9),
    ]
    overrides = {"grid.cell_m": cell, "method.n_way": n_way}
    about: Any = {"dataset": "campus", "simulated": True, "method": "sci"}
    return Record(number, overrides, **about, error=error, rows=[] if error else rows)


BROKEN = job(3, "10", "7", 0.0, "n_way=7: must divide 120")
JOBS = [
    job(0, "5", "1", 0.7),
    job(1, "5", "2", 0.8),
    job(2, "10", "1", 0.9),
    job(4, "20", "2", 0.9),
]
WALLS = Construction(walls=(2,), shadows=(False,))
FIGURES: dict[str, Callable[[], Figure | None]] = {
    "precision over recall": partial(curves.precision_recall, BOTH, "cells"),
    "precision over recall, never seen": partial(curves.precision_recall, [NOTHING], "cells"),
    "the year": lambda: curves.year([bounded(one, 0.1, 0.9) for one in BOTH], "2012-01-15"),
    "the year, one day": partial(curves.year, BOTH[::2], "2012-01-15", curves.FIGURE_8),
    "coverage": partial(curves.coverage, BOTH[::2]),
    "recall at n": partial(curves.recall_at, BOTH),
    "history": partial(curves.history, LOSSES, 1, "sci"),
    "history, kept unknown": partial(curves.history, LOSSES, None, "sci"),
    "novelty": partial(rejection.histograms, ONE, "cells"),
    "novelty, never seen": partial(rejection.histograms, [NOTHING], "cells"),
    "rejection": partial(rejection.rejection, ONE),
    "reliability": partial(rejection.diagram, ONE),
    "matches": lambda: matches.matches(matches.choose(ONE[:1]), TRAINING, lambda _: IMAGES),
    "map": partial(maps.outcome_map, ONE[0], TRAIN_XY_M),
    "map of poses": partial(maps.fix_map, POSED[0], TRAIN_XY_M),
    "montage": partial(maps.montage, BOTH[::-1], TRAIN_XY_M),
    "verdicts": partial(verdicts.verdicts, POSED),
    "probabilities": partial(verdicts.probabilities, POSED),
    "kinds": partial(
        robustness.kinds,
        COMPARED,
        (AUC, AUC_SHARE, RECALL_BY_DISTANCE, HEADING_ERROR),
        TURNED,
        "Turned",
    ),
    "sequences": partial(
        robustness.sequences, COMPARED, dict.fromkeys(COMPARED.sequences, "a"), "Stress"
    ),
    "levels": partial(robustness.levels, BUILT, "Walls", "walls"),
    "ways": partial(robustness.ways, COMPARED, TURNED, ["sci_ring"], "Ways"),
    "cells": partial(robustness.cells, SIZES, (5.0, 10.0, 20.0), ORACLES, "Cells"),
    "ageing": partial(ageing.lines, AGED, FOLLOWED),
    "slopes": partial(ageing.slopes, AGED, FOLLOWED),
    "near changes": near_changes,
    "sweep": partial(response, [BROKEN, *JOBS], ("grid.cell_m", "method.n_way")),
    "sweep of one job": partial(response, JOBS[:1], ()),
    "recall after steps": partial(
        lifelong.matrices, {"a": RECALLS, "b": RECALLS}, STEPS, STEPS, "Recall"
    ),
    "over steps": partial(
        lifelong.over_steps,
        {"days": ["2012-01-15", "2012-03-17"], "streets": STEPS},
        OVER_STEPS,
        "After each step",
    ),
    "known places": partial(lifelong.known_places, {"streets": KNOWN, "days": KNOWN}, TRAIN_XY_M),
    "ages": partial(lifelong.ages, {"days": (XY_M, np.array([30, 0, 30]))}, TRAIN_XY_M),
    "viewpoints": partial(viewpoints.precision_recall, GROUP, "a"),
    "indices": partial(viewpoints.indices, INDICES, (90.0, 270.0), 10.0),
    "reconstructions": partial(
        viewpoints.reconstructions, {"pfl": (SEEN, SEEN), "afl": (SEEN, 255 - SEEN)}
    ),
    "collapse": partial(viewpoints.collapse, CURVES),
    "place": lambda: views.place(views.perturbed(GROUND_M, WALLS, 7), VIEW),
    "bird-view": bird_view,
}


def digest(svg: str) -> str:
    """A digest of what an SVG draws, which holds on other processors and for other builds.

    Coordinates count to two points, and pixels of images do not.
    """
    svg = re.sub(r"(?<=base64,)[^\"]+", "", svg)
    svg = re.sub(r"(?<=[\"#(])[a-z]{1,2}[0-9a-f]{10,}", "", svg)  # ids that hold a hash
    coarse = COORDINATES.sub(
        lambda part: re.sub(r"-?\d+(\.\d+)?", lambda at: f"{float(at[0]) + 0.777:.0f}", part[0]),
        svg,
    )
    return sha256(coarse.encode()).hexdigest()[:16]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_as_it_was_the_same_file_each_time_and_says_that_data_are_simulated(
    name: str, tmp_path: Path, snapshot: SnapshotAssertion
) -> None:
    first, second, recorded = (FIGURES[name]() for _ in range(3))
    assert first is not None
    assert second is not None
    assert recorded is not None
    svg = save(first, tmp_path / "simulated.svg", True).read_text()
    assert save(second, tmp_path / "again.svg", True).read_text() == svg
    assert SIMULATED in words(first)
    text = save(recorded, tmp_path / f"{name}.svg", False).read_text()
    shown = words(recorded)
    assert SIMULATED not in shown
    assert "<dc:date>" not in text
    assert not [word for word in shown if "nan" in word.lower()]
    reported = " | ".join(dict.fromkeys(" ".join(word.split()) for word in shown if word))
    assert f"{digest(text)}: {reported}" == snapshot, f"look at {tmp_path}/{name}.svg"


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (lambda: curves.year([], "2012-01-15"), "at least one result"),
        (lambda: curves.precision_recall([], "cells"), "at least one result"),
        (lambda: response([BROKEN], ("grid.cell_m",)), "nothing to draw"),
        (
            lambda: ageing.lines(table(followed("oracle", NONE, DAYS)), FOLLOWED),
            "at least one model",
        ),
    ],
)
def test_a_figure_of_nothing_is_refused(draw: Callable[[], Figure], said: str) -> None:
    with pytest.raises(InputError, match=said):
        draw()


def test_what_has_nothing_to_show_has_no_figure() -> None:
    assert rejection.diagram([NOTHING]) is None
    assert viewpoints.collapse({"sad": [{}]}) is None
    without = replace(ONE[0].evaluation, confidence=np.full(7, np.nan, np.float32))
    assert rejection.confidences([replace(ONE[0], evaluation=without)]) == []


def test_reliability_pools_the_seen_queries_of_all_sequences() -> None:
    (name, bins, error), (other, scaled, _) = rejection.confidences(ONE)
    assert (name, other) == ("raw: 1 − cost", "temperature-scaled")
    assert bins.count.sum() == scaled.count.sum() == 10
    # Raw confidences .95 .25 .85 .75 .95, of which the first, second and last are right: |.95−1|·2
    # + .75 + .85 + .75 over 5.
    assert error == pytest.approx((0.1 + 0.75 + 0.85 + 0.75) / 5)
