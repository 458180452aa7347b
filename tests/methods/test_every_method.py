"""Tests of what all methods have in common: the same bytes from the same seed, answers that do not
depend on other queries, and views that they refuse."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Rows, TrainingSet
from pipeline.methods.m2dp import M2dp
from pipeline.methods.sad import Sad
from tests.interrupted import PowerCut, same
from tests.matching.made import along
from tests.methods import test_pfl as pfl
from tests.methods import test_pointnetvlad as pointnetvlad
from tests.methods import test_scan_context as scan_context
from tests.methods import test_sci as sci
from tests.methods import test_sci_ring as sci_ring

SIGNATURES = np.random.default_rng(1).random((2, 60, 192), np.float32)
IMAGES = np.zeros((4, 16, 64, 64), np.uint8)
METHODS: dict[str, tuple[Any, Rows, Rows, np.ndarray]] = {
    "sci": (sci.SMALL, sci.rows(2), sci.rows(3), sci.GROUND_TRUTH),
    "sci_ring": (
        replace(sci_ring.SMALL, epochs=3),
        sci_ring.rows(2),
        sci_ring.rows(3),
        sci_ring.GROUND_TRUTH,
    ),
    "fifty": (
        scan_context.FIFTY,
        scan_context.rows(1),
        scan_context.rows(2),
        scan_context.GROUND_TRUTH,
    ),
    "all": (
        scan_context.ALL,
        scan_context.rows(1),
        scan_context.rows(2),
        scan_context.GROUND_TRUTH,
    ),
    "m2dp": (M2dp(), along(SIGNATURES[0]), along(SIGNATURES[1]), np.arange(60)),
    "pointnetvlad": (
        pointnetvlad.SMALL,
        pointnetvlad.rows(),
        pointnetvlad.rows(3),
        pointnetvlad.GROUND_TRUTH,
    ),
    "pfl": (pfl.SMALL, pfl.rows(), pfl.rows(2), pfl.PLACES),
    "sad": (Sad(), along(IMAGES), along(IMAGES), np.arange(4)),
}
"""Each method with training views, queries, and the places of the training views."""
SHARE = Progress(budget=0.25)


def learned(name: str, progress: Progress = SHARE, **settings: Any) -> Model:
    method, views, _, places = METHODS[name]
    return replace(method, **settings).learn(views, places, progress)


@cache
def model_of(name: str) -> Model:
    """The model of a method, learned once for all tests that only query it."""
    return learned(name)


@pytest.mark.parametrize("name", METHODS)
def test_the_same_views_and_seed_give_the_same_bytes_and_another_seed_others(name: str) -> None:
    assert same(learned(name), model_of(name))
    assert not hasattr(METHODS[name][0], "seed") or not same(learned(name, seed=1), model_of(name))


@pytest.mark.parametrize(
    ("name", "settings", "budget"), [("pfl", {}, 0.25), ("pointnetvlad", {"epochs": 2}, 1)]
)
def test_an_interrupted_training_goes_on_to_the_same_bytes(
    tmp_path: Path, name: str, settings: dict[str, Any], budget: float
) -> None:
    # PointNetVLAD: 28 queries a time, 2 a step: three rounds of 10 steps, the second and third with
    # hard negatives.
    whole = learned(name, Progress(budget=budget), **settings)
    rounds = {"pfl": 2, "pointnetvlad": 3}[name]
    assert {
        len(curve) for curve_name, curve in whole.items() if curve_name.startswith("curves/")
    } == {rounds}
    with pytest.raises(KeyboardInterrupt):
        learned(name, PowerCut(budget=budget, checkpoint=tmp_path / "half"), **settings)
    assert (tmp_path / "half").is_file()
    assert same(
        learned(name, Progress(budget=budget, checkpoint=tmp_path / "half"), **settings), whole
    )


@pytest.mark.parametrize("name", ["sci", "sci_ring", "fifty", "all", "m2dp", "pointnetvlad"])
def test_one_query_is_answered_as_in_a_crowd_and_none_not_at_all(name: str) -> None:
    ask = METHODS[name][0].localizer(model_of(name))
    queries = METHODS[name][2]
    crowd = ask(queries, 3)
    none = ask(queries.select(slice(0)), 3)
    for row in (0, 30):
        alone = ask(queries.select(slice(row, row + 1)), 3)
        assert alone.places.tolist() == crowd.places[row : row + 1].tolist()
        # Networks round by what is computed together
        atol = 0 if name in ("fifty", "all", "m2dp") else 1e-5
        np.testing.assert_allclose(alone.costs[0], crowd.costs[row], rtol=0, atol=atol)
        np.testing.assert_allclose(alone.heading_deg, crowd.heading_deg[row : row + 1], atol=1e-2)
    assert len(none.places) == len(none.costs) == len(none.novelty) == len(none.heading_deg) == 0


OTHER_VIEWS: dict[str, dict[tuple[int, ...], str]] = {
    "sci": {(4, 8, 12): "8 rings × 24 sectors"},
    "sci_ring": {(4, 8, 32): "8 rings × 40 sectors"},
    "fifty": {(1, 10, 25): "10 rings × 24 sectors"},
    "all": {(1, 10, 25): "10 rings × 24 sectors"},
    "m2dp": {
        (4, 40, 120): r"\(4, 40, 120\): expected signatures",
        (1, 2): r"expected \(q, d\) like the database's \(60, 192\)",
    },
    "pointnetvlad": {(4, 40, 120): "expected clouds"},
    "pfl": dict.fromkeys([(4, 40, 120), (4, 16, 32, 32), (4, 5, 64, 64)], "expected bird-views"),
    "sad": {(4, 64, 64): r"\(4, 64, 64\): expected bird-views"},
}


@pytest.mark.parametrize("name", OTHER_VIEWS)
def test_other_views_are_refused(name: str) -> None:
    ask = METHODS[name][0].localizer(model_of(name))
    for shape, said in OTHER_VIEWS[name].items():
        with pytest.raises(InputError, match=said):
            ask(along(np.zeros(shape, np.float32)), 1)


@pytest.mark.parametrize("name", [name for name in METHODS if name not in ("pfl", "sad")])
def test_an_extended_model_knows_the_new_place_and_the_old_ones(name: str) -> None:
    method, views, queries, places = METHODS[name]
    is_known = places < places.max()
    budget = Progress(budget=1.0)
    parts = [TrainingSet(views.select(rows), places[rows]) for rows in (is_known, ~is_known)]
    if name in ("sci", "sci_ring"):
        method = replace(method, incremental=0.5, epochs=16)
    model = method.learn(*parts[0], budget)
    incremental = method.extend(model, *parts, budget)
    assert same(method.extend(model, *parts, budget), incremental)
    # Signatures here are made up, another day's are others
    queries = views if name == "m2dp" else queries
    answers = method.localizer(incremental)(queries, 1).places[:, 0]
    assert (answers == places)[is_known].mean() > 0.9
    assert (answers == places)[~is_known].mean() > 0.9
    assert (method.localizer(model)(queries, 1).places[:, 0] == places)[~is_known].mean() == 0


@pytest.mark.parametrize("name", ["pfl", "sad"])
def test_an_extended_database_of_sequences_has_all_rows_and_the_same_networks(name: str) -> None:
    method, views, _, places = METHODS[name]
    is_known = np.arange(len(places)) < len(places) - 1
    is_known[np.unique(places, return_index=True)[1]] = True
    model = method.learn(views.select(is_known), places[is_known], SHARE)
    new = (
        TrainingSet(views.select(~is_known), places[~is_known])
        if (~is_known).any()
        else TrainingSet(views.select(slice(1)), places[:1])
    )
    incremental = method.extend(
        model, TrainingSet(views.select(is_known), places[is_known]), new, SHARE
    )
    assert len(incremental["database/places"]) == is_known.sum() + len(new)
    networks = [key for key in model if key.startswith("net/")]
    assert all(np.array_equal(incremental[key], model[key]) for key in networks)


def test_a_place_without_a_view_is_refused() -> None:
    views = along(SIGNATURES[0][:2])
    with pytest.raises(InputError, match="place 1 of 3 has no view"):
        TrainingSet.joined([TrainingSet(views, np.array([0, 2]))])
