"""A comparison of models gives means, deviations, shares that are kept, clear margins and N
ways."""

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.report.comparison import (
    AUC,
    AUC_SHARE,
    HEADING_ERROR,
    ONE_SEED,
    RECALL_BY_DISTANCE,
    Comparison,
    Kind,
    Measurement,
)
from tests.report.figures.made import BUILT, COMPARED, DAYS, TURNED, compared

NAN = np.nan


def test_what_was_found_is_averaged_over_repeats_seeds_and_sequences() -> None:
    found = Measurement(
        np.array([[[0.9, 0.7], [0.5, NAN]], [[0.6, 0.6], [NAN, NAN]]])
    )  # (seed, sequence, repeat)
    assert found.by_sequence == pytest.approx([0.7, 0.5])  # .8 and .6; .5 of one seed alone
    assert found.mean == pytest.approx(0.6)
    assert found.by_seed == pytest.approx([0.65, 0.6])
    assert found.by_repeat == pytest.approx([(0.75 + 0.5) / 2, 0.65])
    assert found.on(1).mean == 0.5
    half = np.sqrt(2) / 2  # of two values, their deviation is that share of what lies between them
    assert (found.over_sequences, found.over_seeds) == pytest.approx((0.2 * half, 0.05 * half))
    assert found.over_repeats == pytest.approx((0.2 * half + 0.0) / 2)  # where there are two
    nothing = Measurement(np.full((1, 2, 1), NAN))
    assert np.isnan(
        [nothing.mean, nothing.over_sequences, nothing.over_seeds, nothing.over_repeats]
    ).all()


def test_a_comparison_has_models_kinds_seeds_and_repeats_in_their_order() -> None:
    assert COMPARED.models == ["sci", "sci-4way", "sci_ring"]
    assert (COMPARED.kinds, COMPARED.changes, COMPARED.sequences) == (
        [Kind(), TURNED],
        [TURNED],
        list(DAYS[:2]),
    )
    assert (COMPARED.seeds, COMPARED.repeats) == ({"sci": 1, "sci-4way": 1, "sci_ring": 2}, 2)
    assert COMPARED.ordered(TURNED, AUC) == ["sci_ring", "sci-4way", "sci"]
    assert COMPARED.ways() == {2: "sci", 4: "sci-4way"}
    assert compared({("sci", Kind()): [[[0.5]]]}, {}).ways() == {}
    kinds = (
        Kind(),
        TURNED,
        Kind("demolition", 60.0),
        Kind("construction", 1.0),
        Kind("construction", 2.0, True),
    )
    assert [one.label for one in kinds] == [
        "unperturbed",
        "turned",
        "60° removed",
        "1 new wall",
        "2 new walls and shadow",
    ]


def test_kept_is_the_share_of_the_same_seeds_and_sequences_auc_unperturbed() -> None:
    assert COMPARED.measurement("sci", TURNED, AUC_SHARE).values.tolist() == [
        [pytest.approx([0.25, 0.25]), pytest.approx([0.5, 0.5])]
    ]
    assert COMPARED.measurement("sci_ring", TURNED, AUC_SHARE).values[1, 1] == pytest.approx(
        [0.7 / 0.8, 0.74 / 0.8]
    )
    assert BUILT.measurement(
        "sci", Kind("construction", 2.0, True), AUC_SHARE
    ).mean == pytest.approx(0.3 / 0.8)
    none = compared({("sci", Kind()): [[[0.0]]], ("sci", TURNED): [[[0.5]]]}, {})
    assert np.isnan(none.measurement("sci", TURNED, AUC_SHARE).mean)  # of nothing, no share is kept


def pair(one: Sequence[float], other: Sequence[float], seeds: int = 1) -> Comparison:
    return compared(
        {
            ("sci", Kind()): [[[v] for v in one]] * seeds,
            ("m2dp", Kind()): [[[v] for v in other]] * seeds,
        },
        {},
    )


@pytest.mark.parametrize(
    ("one", "other", "seeds", "clear"),
    [
        ((0.9, 0.8), (0.5, 0.45), 1, True),
        ((0.9, 0.8), (0.5, 0.81), 1, False),  # not on every sequence
        ((0.9, 0.6), (0.5, 0.58), 1, False),  # by .21 on average, .27 from one to the next
        ((0.91, 0.81), (0.9, 0.8), 1, False),  # less than another seed may do
        ((0.91, 0.81), (0.9, 0.8), 2, True),  # which two equal seeds show that it does not
        ((0.5, 0.45), (0.9, 0.8), 1, True),  # behind as well as ahead
        ((0.9,), (0.1,), 1, False),  # one sequence shows nothing
        ((0.9, NAN), (0.1, 0.2), 1, False),
    ],
)
def test_a_margin_is_clear_on_every_sequence_and_beyond_what_days_and_seeds_do(
    one: tuple[float, ...], other: tuple[float, ...], seeds: int, clear: bool
) -> None:
    margin = pair(one, other, seeds).ahead("sci", "m2dp", Kind(), AUC)
    apart = np.subtract(one, other)[np.isfinite(np.subtract(one, other))]
    assert (margin.value, margin.number, margin.clear) == (
        pytest.approx(apart.mean()),
        len(apart),
        clear,
    )
    assert ONE_SEED == 0.02


def test_without_a_common_sequence_there_is_no_margin() -> None:
    margin = pair((0.9, NAN), (NAN, 0.1)).ahead("sci", "m2dp", Kind(), RECALL_BY_DISTANCE)
    assert np.isnan(margin.value)
    assert (margin.number, margin.clear) == (0, False)
    assert COMPARED.measurement("sci", TURNED, HEADING_ERROR).mean == pytest.approx(
        0.3
    )  # every number has its own rows
