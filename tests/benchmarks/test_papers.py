"""Tests of the verdicts on the papers' findings, and that docs/papers.md follows from the
tables."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmarks.papers import kept
from benchmarks.papers.claims import CLAIMS
from benchmarks.papers.judging import (
    CONTRADICTED,
    SHOWN,
    UNDECIDED,
    Estimate,
    Outcome,
    Side,
    Tables,
    ascend,
    at_every_heading,
    by_interval,
    difference_of,
    has_no_verdict,
    is_ahead,
    is_below,
    is_not_measured,
    keeps_less,
    spreads_less,
)
from benchmarks.papers.page import page, words
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.evaluation.rows import HEADING, NOVELTY, PERTURBED, STRESS, VIEWPOINT, row, table
from tests.studies.made import study

ROOT = Path(__file__).parents[2]
SCI, SCAN_CONTEXT, M2DP = (
    Side("compare", "campus", method) for method in ("sci", "scan_context", "m2dp")
)
PFL, AFL, SAD = (
    Side("street", "suburb", method, "accuracy", "distance", ask=VIEWPOINT, of=HEADING, at=None)
    for method in ("pfl", "afl", "sad")
)
MS = Side("compare", "campus", "sci", "query_ms", "")
STUDY = {"campus": study(world="campus_demo", budget="demo")}


def rows(side: Side, *values: float, half: float = 0.01, **columns: Any) -> list[dict[str, Any]]:
    """A row for each value, one a sequence, with an interval of +-half."""
    place: dict[str, Any] = {"grid": side.grid, "method": side.method, "variant": side.variant}
    place |= {"ask": side.ask, "of": side.of, "at": side.at or 0.0, **columns}
    return [
        place
        | {"sequence": f"day {day}"}
        | row(side.number, side.protocol, value, value - half, value + half)
        for day, value in enumerate(values)
    ]


def headings(side: Side, values: Sequence[float], seed: int = 0) -> list[dict[str, Any]]:
    """A row for each value, one a heading: 22.5, 112.5, 202.5 … degrees; no intervals."""
    return [
        {"method": side.method, "sequence": "00", "grid": "10m", "seed": seed}
        | {"ask": VIEWPOINT, "of": HEADING, "at": 22.5 + 90.0 * turn}
        | row(side.number, side.protocol, value)
        for turn, value in enumerate(values)
    ]


def tables(*groups: list[dict[str, Any]], name: str = "compare", study: str = "campus") -> Tables:
    common = {"study": study, "dataset": study, "simulated": True}
    return Tables({name: table((line for group in groups for line in group), **common)})


def street(*groups: list[dict[str, Any]]) -> Tables:
    return tables(*groups, name="street", study="suburb")


def judged(measure: Any, given: Tables) -> tuple[str, str]:
    outcome: Outcome = measure(given)
    return outcome.verdict, outcome.reason


@pytest.mark.parametrize(
    ("difference", "of_seeds", "expected"),
    [
        (Estimate(0.1, 0.05, 0.15), [0.1], (SHOWN, "interval")),
        (Estimate(-0.1, -0.15, -0.05), [-0.1], (CONTRADICTED, "interval")),
        (Estimate(0.1, -0.05, 0.25), [0.1], (UNDECIDED, "across")),
        (Estimate(0.1), [0.1], (UNDECIDED, "across")),
        (Estimate(0.015, 0.01, 0.02), [0.015], (UNDECIDED, "seed")),
        (Estimate(0.015, 0.01, 0.02), [0.01, 0.02], (SHOWN, "interval")),
        (Estimate(0.1, 0.05, 0.15), [0.3, -0.1], (UNDECIDED, "seed")),
    ],
)
def test_an_interval_and_all_seeds_must_exclude_0(
    difference: Estimate, of_seeds: list[float], expected: tuple[str, str]
) -> None:
    assert by_interval(difference, of_seeds) == expected


def test_half_widths_add_as_squares_do() -> None:
    difference = difference_of(Estimate(0.8, 0.77, 0.81), Estimate(0.5, 0.4, 0.54), 1.0)
    assert difference == pytest.approx((0.3, 0.25, 0.3 + (0.01**2 + 0.1**2) ** 0.5))
    assert difference_of(Estimate(0.9, 0.9, 0.9), Estimate(0.5, 0.4, 0.6), 0.9) == pytest.approx(
        (0.45, 0.36, 0.54)
    )


def test_one_method_is_compared_with_the_strongest_of_the_others() -> None:
    others = (rows(SCAN_CONTEXT, 0.6, 0.7), rows(M2DP, 0.2, 0.3))
    measure = is_ahead(SCI, SCAN_CONTEXT, M2DP)
    for values, expected in (
        ((0.8, 0.9), (SHOWN, "interval")),
        ((0.4, 0.5), (CONTRADICTED, "interval")),
        ((0.61, 0.69), (UNDECIDED, "across")),
    ):
        outcome = measure(tables(rows(SCI, *values), *others))
        assert (outcome.verdict, outcome.reason) == expected
        assert [side for side, _ in outcome.sides] == [SCI, SCAN_CONTEXT]
        assert (outcome.seeds, outcome.pairs) == (1, 2)
    assert judged(is_ahead(SCI, SCAN_CONTEXT, sign=-1), tables(rows(SCI, 0.4), *others)) == (
        SHOWN,
        "interval",
    )


def test_seeds_of_one_method_stand_beside_the_only_one_of_another() -> None:
    first, second = rows(SCI, 0.9), rows(SCI, 0.5, seed=1)
    outcome = is_ahead(SCI, SCAN_CONTEXT)(tables(first, second, rows(SCAN_CONTEXT, 0.6)))
    assert (outcome.verdict, outcome.reason, outcome.seeds) == (UNDECIDED, "seed", 2)


def test_only_sequences_that_both_have_are_compared_and_repeats_are_one() -> None:
    turned = Side("compare", "campus", "m2dp", ask=PERTURBED, of="turned")
    given = tables(
        rows(turned, 0.5), rows(turned, 0.7, repeat=1), rows(M2DP, 0.6, 0.1, 0.1), rows(SCI, 0.9)
    )
    outcome = is_ahead(turned, M2DP, factor=0.9)(given)
    assert [estimate.value for _, estimate in outcome.sides] == pytest.approx([0.6, 0.6])
    assert outcome.difference.value == pytest.approx(0.06)
    assert (outcome.verdict, outcome.pairs) == (SHOWN, 1)


def test_a_number_of_another_kind_cells_or_protocol_is_not_taken() -> None:
    given = tables(
        rows(SCI, 0.9),
        rows(SCI, 0.1, ask=NOVELTY, of="energy"),
        rows(SCI, 0.1, grid="5m"),
        rows(SCI, 0.1, ask=STRESS, of="all reversed"),
        rows(SCI, 0.1, ask=PERTURBED, of="construction", at=2.0),
        rows(Side("compare", "campus", "sci", protocol="distance"), 0.1),
        rows(SCAN_CONTEXT, 0.6),
    )
    assert is_ahead(SCI, SCAN_CONTEXT)(given).sides[0][1].value == pytest.approx(0.9)
    assert given.used["compare"] == {0, 6}


def test_what_is_missing_is_named() -> None:
    for given, expected in (
        (tables(rows(SCI, 0.9)), (SCAN_CONTEXT, M2DP)),
        (tables(rows(M2DP, 0.9)), (SCI, SCAN_CONTEXT)),
        (Tables({}), (SCI, SCAN_CONTEXT, M2DP)),
    ):
        outcome = is_ahead(SCI, SCAN_CONTEXT, M2DP)(given)
        assert (outcome.verdict, outcome.reason) == (UNDECIDED, "missing")
        assert outcome.missing == expected


def test_every_heading_must_agree_and_three_trainings() -> None:
    reference = headings(AFL, [0.4, 0.5, 0.4])
    measure = at_every_heading(PFL, AFL)
    for values, expected in (
        ([0.5, 0.6, 0.5], (SHOWN, "all")),
        ([0.3, 0.4, 0.3], (CONTRADICTED, "all")),
        ([0.5, 0.6, 0.3], (UNDECIDED, "mixed")),
    ):
        seeds = [headings(PFL, values, seed=seed) for seed in range(3)]
        outcome = measure(street(*seeds, reference))
        assert (outcome.verdict, outcome.reason) == expected
        assert outcome.pairs == 3
        of_two = judged(measure, street(*seeds[:2], reference))
        assert of_two == ((UNDECIDED, "one_training") if expected[1] == "all" else expected)
    untrained = headings(SAD, [0.1, 0.1, 0.1])
    of_one = street(headings(PFL, [0.5, 0.6, 0.5]), untrained)
    assert judged(at_every_heading(PFL, SAD), of_one) == (SHOWN, "all")
    level = street(headings(PFL, [0.5, 0.6, 0.11]), untrained)  # one seed may make so much
    assert judged(at_every_heading(PFL, SAD), level) == (UNDECIDED, "mixed")


def test_an_error_is_better_where_it_is_less() -> None:
    drawn, black = (
        Side("street", "suburb", "pfl", number, "", ask=VIEWPOINT)
        for number in ("validation_error", "black_error")
    )
    measure = at_every_heading(drawn, black, sign=-1)
    for value, expected in (
        (0.1, (SHOWN, "all")),
        (0.3, (CONTRADICTED, "all")),
        (0.21, (UNDECIDED, "mixed")),
    ):
        assert judged(measure, street(rows(drawn, value), rows(black, 0.2))) == expected
    assert (drawn.label, black.label) == ("`pfl`", "a black image")


def test_headings_within_and_beyond_an_angle_are_compared_with_a_limit() -> None:
    near = at_every_heading(PFL, None, within_deg=30, limit=0.5)
    beyond = at_every_heading(PFL, None, sign=-1, beyond_deg=30, limit=0.5)
    given = street(headings(PFL, [0.6, 0.4, 0.3]))
    assert judged(near, given) == judged(beyond, given) == (SHOWN, "all")
    given = street(headings(PFL, [0.4, 0.6, 0.7]))
    assert judged(near, given) == judged(beyond, given) == (CONTRADICTED, "all")
    given = street(headings(PFL, [0.5, 0.6, 0.3]))
    assert judged(near, given) == judged(beyond, given) == (UNDECIDED, "mixed")


def test_a_limit_and_an_order_of_times() -> None:
    for values, verdict in (((40, 50), SHOWN), ((140, 150), CONTRADICTED), ((40, 150), UNDECIDED)):
        assert judged(is_below(MS, 100), tables(rows(MS, *values))) == (verdict, "limit")
    other = Side("compare", "campus", "m2dp", "query_ms", "")
    for value, verdict in ((9, SHOWN), (4, CONTRADICTED), (7, UNDECIDED)):
        given = tables(rows(MS, 8), rows(other, value))
        assert judged(ascend(MS, other), given) == (verdict, "order")


def test_stability_takes_three_seeds() -> None:
    wild = [headings(AFL, [0.50 + 0.10 * seed, 0.6 + 0.1 * seed], seed) for seed in range(3)]
    calm = [headings(PFL, [0.50 + 0.01 * seed, 0.6 + 0.01 * seed], seed) for seed in range(3)]
    assert judged(spreads_less(PFL, AFL), street(*calm, *wild)) == (SHOWN, "all")
    assert judged(spreads_less(AFL, PFL), street(*calm, *wild)) == (CONTRADICTED, "all")
    assert judged(spreads_less(PFL, AFL), street(*calm[:2], *wild)) == (UNDECIDED, "few_seeds")


def test_a_finding_of_unknown_direction_or_without_numbers_has_no_verdict() -> None:
    given = tables(rows(SCI, 0.9), rows(M2DP, 0.2))
    outcome = has_no_verdict(SCI, M2DP)(given)
    assert (outcome.verdict, outcome.reason) == (UNDECIDED, "unknown_direction")
    assert outcome.sides[1][1].value == pytest.approx(0.2)
    assert judged(has_no_verdict(SCI, SCAN_CONTEXT), given) == (UNDECIDED, "missing")
    assert judged(is_not_measured, given) == (UNDECIDED, "absent")


def results() -> pd.DataFrame:
    lines = [
        *rows(SCI, 0.8, 0.9),
        *rows(SCAN_CONTEXT, 0.6, 0.7),
        *rows(Side("compare", "campus", "sci", "f1_max"), 0.5),
    ]
    return table(lines, study="campus", dataset="campus", simulated=True)


def test_a_kept_table_has_the_rows_that_findings_read_and_says_what_made_it(tmp_path: Path) -> None:
    assert set(kept.kept_rows("compare", results())["number"]) == {"auc_top1"}
    (tmp_path / "compare.yaml").write_text("use: campus world=demo\ncost: minutes\n")
    kept.keep("compare", results(), STUDY, "2026-11-26", "a processor", tmp_path)
    again = kept.read(tmp_path)
    assert list(again.frames) == ["compare"]
    assert again.frames["compare"]["value"].tolist() == pytest.approx([0.8, 0.9, 0.6, 0.7])
    origin = dict(again.origins["compare"])
    reported = origin.pop("studies")["campus"]
    assert (reported["world"], reported["budget"]) == ("campus_demo", "demo")
    assert reported["methods"] == [{"name": "sci", "view": "scan_context_authors"}]
    assert origin == {
        "use": "campus world=demo",
        "cost": "minutes",
        "made": "2026-11-26",
        "machine": "a processor",
    }
    assert again.outcomes["trained_in_full"].reason == "missing"


def test_a_table_of_another_name_or_of_other_studies_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--keep mine: expected one of nway, street, compare"):
        kept.keep("mine", results(), STUDY, "", "", tmp_path)
    with pytest.raises(ConfigError, match="--keep street: the studies in use have none"):
        kept.keep("street", results(), STUDY, "", "", tmp_path)
    (tmp_path / "compare.yaml").write_text("use: campus town world=demo\n")
    with pytest.raises(ConfigError, match=r"is of campus, town, and campus are in use; call"):
        kept.keep("compare", results(), STUDY, "", "", tmp_path)
    assert not list(tmp_path.glob("*.csv"))


def test_a_broken_table_or_one_of_unknown_origin_is_named(tmp_path: Path) -> None:
    path = tmp_path / "compare.csv"
    path.write_text("method,value\nsci,1\n")
    with pytest.raises(ArtifactError, match=r"compare.csv: not a kept table of results .*--keep"):
        kept.read(tmp_path)
    kept.keep("compare", results(), STUDY, "", "", tmp_path)
    path.with_suffix(".yaml").unlink()
    with pytest.raises(ArtifactError, match=r"compare.yaml: no such file, which says what made"):
        kept.read(tmp_path)


def test_every_finding_has_words_and_every_reason_too() -> None:
    texts: Mapping[str, Any] = words()["findings"]
    assert list(texts) == [claim.name for claim in CLAIMS]
    assert {claim.paper for claim in CLAIMS} == set(words()["papers"])
    assert set(words()["tables"]) == set(kept.NAMES)
    assert all(
        {"finding"} <= set(text) <= {"finding", "there", "note", "headline"}
        for text in texts.values()
    )


def test_a_row_says_number_data_and_why_and_headlines_stand_on_top(tmp_path: Path) -> None:
    walls = Side("compare", "campus", "m2dp", ask=PERTURBED, of="construction", at=2.0)
    lines = [*rows(walls, 0.1), *rows(M2DP, 0.5), *rows(SCI, 0.8)]
    given = table(lines, study="campus", dataset="campus", simulated=True)
    kept.keep("compare", given, STUDY, "2026-11-26", "a processor", tmp_path)
    text = page(kept.read(tmp_path))
    assert (
        "- **Two new walls cost M2DP nearly all of its AUC**: it is 0.100 [.09, .11], and "
        "0.500 [.49, .51] unperturbed." in text
    )
    assert (
        "| `m2dp` 2 new walls 0.100 [.09, .11], `m2dp` 0.500 [.49, .51]; nothing is trained "
        "| campus, simulated: `compare` | **contradicted**, a headline. The difference to nine tenths "
        "of the second is −0.350 [−.36, −.34], in the other direction, and 0 is outside. |" in text
    )
    assert "No table `nway` is kept: `make papers`." in text
    assert "| campus `demo` | a processor | 2026-11-26 |" in text


def test_a_headline_says_when_its_interval_is_too_wide(tmp_path: Path) -> None:
    turned = Side("compare", "campus", "scan_context", ask=PERTURBED, of="turned")
    lines = [*rows(turned, 0.7, half=0.2), *rows(SCAN_CONTEXT, 0.7, half=0.2)]
    given = table(lines, study="campus", dataset="campus", simulated=True)
    kept.keep("compare", given, STUDY, "2026-11-26", "a processor", tmp_path)
    text = page(kept.read(tmp_path))
    assert "- **Scan Context loses nothing when the robot is turned**: its AUC is 0.700" in text
    assert "lose: not decidable here, since two intervals of the same queries allow" in text
    assert "0 is inside; a paired interval of the same queries would be narrower. |" in text


@pytest.mark.parametrize(
    ("kept_auc", "expected"), [(1.0, CONTRADICTED), (0.7, SHOWN), (0.91, UNDECIDED)]
)
def test_perturbed_queries_are_compared_with_the_same_queries_unperturbed(
    kept_auc: float, expected: str
) -> None:
    # Two intervals of ±.2 decide nothing; a paired bootstrap knows the share to ±.05.
    turned = Side("compare", "campus", "scan_context", ask=PERTURBED, of="turned")
    wide = [*rows(turned, 0.7, half=0.2), *rows(SCAN_CONTEXT, 0.7, half=0.2)]
    measure = keeps_less(turned, SCAN_CONTEXT)
    assert judged(measure, tables(wide)) == (UNDECIDED, "across")
    paired = rows(replace(turned, number="auc_exact_top1_kept"), kept_auc, half=0.05)
    assert judged(measure, tables(wide, paired)) == (expected, "paired")
    assert judged(measure, tables(paired)) == (UNDECIDED, "missing")


def test_the_page_is_what_the_generator_gives() -> None:
    assert (ROOT / "docs/papers.md").read_text(encoding="utf-8") == page(
        kept.read(ROOT / kept.FOLDER)
    )


def test_makefile_and_tables_agree() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    made = next(line for line in makefile.splitlines() if line.startswith("PAPERS := ")).split()[2:]
    for name in made:
        yaml_text = (ROOT / kept.FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
        assert {"use", "cost"} <= {line.partition(":")[0] for line in yaml_text.splitlines()}
    assert set(made) == {name for name in kept.NAMES if words()["tables"][name] == "`make papers`"}
