"""Findings, worked out by hand on small tables, and the sentences that they become."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.evaluation.doubts import DOUBTS, VOID
from pipeline.evaluation.rows import row, table
from pipeline.report import case_findings as cases
from pipeline.report import findings
from pipeline.report.comparison import AUC, Kind
from pipeline.report.findings import Finding
from pipeline.report.render import percent, sentence
from pipeline.report.result import Result
from pipeline.report.study import Study, TrainingRecord
from tests.report.figures.made import BUILT, COMPARED, DAYS, ONE, TURNED, compared

NAN = np.nan
DRIVEN = Kind()
DAYS_AFTER = (20, 152)


def reporting(study: Study, given: Sequence[Result], rounds: int = 0) -> Study:
    """The study, but with these results of its models."""
    one = replace(study)
    names = list(dict.fromkeys(each.model for each in given))
    learned = TrainingRecord(
        {"budget": "0.03"}, {"loss": np.ones(rounds)} if rounds else {}, None, 1.0
    )
    vars(one).update(
        results=list(given),
        families=names,
        models=dict.fromkeys(names, learned),
        distance=study.distance,
    )
    return one


def numbered(model: str, days: int, **cells_and_distance: tuple[float, float]) -> Result:
    """A result of a model, with these numbers by cells and by distance."""
    numbers = dict(ONE[0].numbers)
    for name, values in cells_and_distance.items():
        numbers |= {
            (by, name): (value, NAN, NAN)
            for by, value in zip(("cells", "distance"), values, strict=True)
        }
    return replace(
        ONE[0], model=model, sequence=DAYS[0] if days < 100 else DAYS[1], days=days, numbers=numbers
    )


def test_the_answer_names_the_best_model_by_distance_and_how_the_others_fare(study: Study) -> None:
    nothing = {"precision_at_threshold": (NAN, NAN), "recall_at_threshold": (0.0, 0.0)}
    best = [
        numbered("sci", 20, recall_at_1=(0.5, 0.9)),
        numbered("sci", 152, recall_at_1=(0.4, 0.7)),
    ]
    others = [
        numbered(model, 20, recall_at_1=(0.9, share))
        for model, share in (("a", 0.5), ("b", 0.4), ("c", 0.3))
    ]
    found = findings.answer(reporting(study, [*others[:1], *best], rounds=2))
    assert (found.values["first"]["model"], found.values["first"]["mean"]) == (
        "sci",
        {"cells": 0.45, "distance": pytest.approx(0.8)},
    )
    text = sentence(found)
    assert (
        "`sci` (given 3 % of its full training) answers with a place within 15 m for **80 %**"
        in text
    )
    assert (
        "It goes from 90 % after 20 days to 70 % after 152 days. Next is `a` with 50 %. Left to "
        "reject" in text
    )
    assert (
        "for a precision of 90 %, it still places 60 % of them, and 60 % of its answers are right."
        in text
    )
    alone = sentence(
        findings.answer(reporting(study, [numbered("sci", 20, recall_at_1=(0.5, 0.9), **nothing)]))
    )
    assert "(mean of 1 test day), and with the very cell of 10 m for 50 %. Left" in alone
    assert alone.endswith("for a precision of 90 %, it places none of them.")
    assert "with 50 %; the other has 40 %." in sentence(
        findings.answer(reporting(study, [*best, *others[:2]]))
    )
    assert "with 50 %; the others lie between 30 % and 40 %." in sentence(
        findings.answer(reporting(study, [*best, *others]))
    )
    kept = {("distance", "kept_precision"): (0.731, NAN, NAN)}
    lower = [replace(one, numbers={**one.numbers, **kept}) for one in best]
    unkept = (
        "training day and that keeps a precision of 73.1 % there, not the wanted 90 %, it still "
        "places 60 % of them"
    )
    assert unkept in sentence(findings.answer(reporting(study, lower)))
    assert percent(NAN) == "–"


def test_doubts_are_said_once_where_both_protocols_share_them(study: Study) -> None:
    def doubted(model: str, sequence: int, **doubts: tuple[float, float]) -> Result:
        known = numbered(model, 20, blind_recall_at_1=(0.2, 0.75), **doubts)
        own = {
            key: values
            for key, values in known.numbers.items()
            if key[1] in doubts or key[1] not in (VOID, *DOUBTS)
        }
        return replace(known, sequence=DAYS[sequence], days=DAYS_AFTER[sequence], numbers=own)

    sure = doubted("sci", 0)
    small = doubted("b", 0, void=(NAN, 1.0))
    del small.numbers["cells", VOID]  # type: ignore[attr-defined]
    less = findings.doubts(reporting(study, [doubted("a", 0, doubt_less_kept=(0.731, 0.731))]))
    assert [sentence(one) for one in less] == [
        "Doubtful: `a`, by both protocols: its threshold keeps a precision of 0.731 on held-out "
        "blocks, where 0.9 was wanted."
    ]
    several = [
        sure,
        doubted("a", 0, doubt_one_answer=(0.8, 0.8), doubt_no_threshold=(1, 1)),
        small,
        doubted("b", 1),
    ]
    found = findings.doubts(reporting(study, several))
    assert [sentence(one) for one in found] == [
        "Doubtful: `a`, by both protocols: 80 % of the queries get one and the same answer; no "
        "threshold kept a precision of 0.9 on held-out blocks, which are too few to offer less, "
        "so every query is rejected.",
        "Doubtful: `b`, by distance: **void**, as one and the same answer to every query would "
        f"have a recall@1 of 0.750 ({DAYS[0]}).",
    ]


def against(
    sequence: str, recall: tuple[float, float], auc: tuple[float, float]
) -> list[dict[str, Any]]:
    place = {"method": "m2dp", "change": "against", "kind": "sci", "sequence": sequence}
    told = {"recall_at_1": recall, "auc_exact_top1": auc}
    ends = [
        (f"{name}_difference{end}", value)
        for name, pair in told.items()
        for end, value in zip(("", "_p"), pair, strict=True)
    ]
    return [place | row(name, "cells", value) for name, value in ends]


def test_the_paired_test_says_where_a_model_is_better_and_where_worse() -> None:
    rows = [
        *against("2012-02-04", (0.3, 0.01), (0.1, 0.2)),
        *against("2012-06-15", (-0.1, 0.04), (-0.2, 0.3)),
    ]
    (found,) = findings.paired(table(rows), "cells")
    recall = found.values["verdicts"][0]
    assert (recall["mean"], recall["better"], recall["worse"]) == (
        pytest.approx(0.1),
        ["2012-02-04"],
        ["2012-06-15"],
    )
    assert sentence(found) == (
        "`m2dp` against `sci`, by cells: recall@1 +0.100 on average, better on 1 of 2 "
        "(2012-02-04), worse on 1 of 2 (2012-06-15); exact AUC −0.050 on average, undecided."
    )
    assert findings.paired(table(rows), "distance") == []


def test_novelties_say_which_kind_tells_unseen_from_seen_best(study: Study) -> None:
    # ONE's entropy ranks 9 of 10 pairs right, its energy all; energy's threshold accepts the five
    # seen, three of them right.
    (found,) = findings.novelties(reporting(study, ONE), "cells")
    assert [(one["kind"], one["auroc"]) for one in found.values["ranked"]] == [
        ("energy", 1.0),
        ("entropy", pytest.approx(0.9)),
    ]
    assert (found.values["ahead"], found.values["kept"]["kind"]) == (2, "energy")
    text = sentence(found)
    assert (
        "energy tells unseen from seen best (mean AUROC 1.000): ahead of entropy, in use, in 2 of "
        "2 sequences, by more" in text
    )
    assert text.endswith(
        "missed it least, by 0.300 on average; the lowest precision was 0.600, the mean recall "
        "1.000."
    )
    one = replace(ONE[0], evaluation=replace(ONE[0].evaluation, kinds=("cost", "ratio")))
    cells = replace(one.evaluation.cells, rejection=one.evaluation.cells.rejection[::-1])
    used = replace(
        one, evaluation=replace(one.evaluation, judgements=(cells, one.evaluation.distance))
    )
    assert (
        "no other kind tells unseen from seen better than cost, in use (mean AUROC 1.000; next "
        "ratio, 0.900)" in sentence(findings.novelties(reporting(study, [used]), "cells")[0])
    )
    single = replace(cells, rejection=cells.rejection[:1])
    alone = replace(
        one, evaluation=replace(one.evaluation, kinds=("cost",), judgements=(cells, single))
    )
    text = sentence(findings.novelties(reporting(study, [alone]), "distance")[0])
    assert text == "`sci`, by distance: cost has a mean AUROC of 1.000."
    blind = replace(single, rejection=np.full_like(single.rejection, NAN))
    assert (
        findings.novelties(
            reporting(
                study,
                [replace(alone, evaluation=replace(alone.evaluation, judgements=(cells, blind)))],
            ),
            "distance",
        )
        == []
    )


def slopes(
    of: Mapping[str, tuple[float, float, float]], number: str = "auroc", protocol: str = "distance"
) -> pd.DataFrame:
    return table(
        [
            {"method": model} | row(f"{number}_per_100_days", protocol, *values)
            for model, values in of.items()
        ]
    )


def test_ageing_names_who_clearly_loses_and_what_cannot_be_ruled_out() -> None:
    rows = slopes(
        {"sci": (-0.1, -0.15, -0.05), "m2dp": (0.01, -0.02, 0.04), "oracle": (-0.5, -0.6, -0.4)}
    )
    lost = table(
        [{"method": "sci"} | row("auroc_retrain_after_days", "distance", 95.0, 60.0, 190.0)]
    )
    every = pd.concat([rows, lost])
    found = findings.ageing(every, "AUROC, by distance", "distance", "auroc", 90)
    assert [one["model"] for one in found.values["falls"]] == ["sci"]
    assert found.values["worst"] == {"model": "m2dp", "slope": -0.02}
    assert sentence(found) == (
        "AUROC, by distance: `sci` −0.100 [−0.150, −0.050] per 100 days, a tenth lost after 95 "
        "days, by extrapolation: train again by then. For the others no ageing is shown within 90 "
        "days; yet a loss of up to 0.020 per 100 days (`m2dp`) cannot be ruled out."
    )
    only = sentence(
        findings.ageing(
            pd.concat([slopes({"sci": (-0.1, -0.15, -0.05)}), lost]), "A", "distance", "auroc", 287
        )
    )
    assert (
        only
        == "A: `sci` −0.100 [−0.150, −0.050] per 100 days, a tenth lost after 95 days: train again by then."
    )
    rises = findings.ageing(slopes({"sci": (0.1, 0.05, 0.15)}), "A", "distance", "auroc", 287)
    assert sentence(rises) == "A: no ageing is shown within 287 days."
    few = findings.ageing(slopes({"sci": (-0.1, NAN, NAN)}), "A", "distance", "auroc", 287)
    assert sentence(few) == "A: too few test sequences for an interval."


def test_newer_and_the_slopes_are_counted_with_what_chance_would_give() -> None:
    rows = slopes({"sci": (3.0, 1.0, 5.0), "m2dp": (1.0, -1.0, 3.0)}, "novelty_percentile")
    assert "the days to `sci` (+3.0 [+1.0, +5.0] per 100 days), to the others not" in sentence(
        findings.newer(rows)
    )
    flat = slopes({"m2dp": (1.0, -1.0, 3.0)}, "novelty_percentile")
    assert sentence(findings.newer(flat)).startswith(
        "Seen places look newer with the days clearly to no model; 50"
    )
    assert "too few test sequences to say" in sentence(
        findings.newer(slopes({"sci": (1.0, NAN, NAN)}, "novelty_percentile"))
    )
    oracle = table(
        [
            {"method": "oracle"}
            | row("recall_at_1_same_heading_per_100_days", "cells", -0.01, -0.02, 0.0)
        ]
    )
    falls = slopes({"sci": (-0.1, -0.2, -0.01), "m2dp": (0, -1, 1)}, "auc_top1", "cells")
    found = findings.slopes_counted(
        pd.concat([rows, falls, oracle]),
        [("distance", "novelty_percentile"), ("cells", "auc_top1")],
    )
    assert (found.values["worse"], found.values["number"], found.values["chance"]) == (
        2,
        4,
        pytest.approx(0.1),
    )
    assert sentence(found) == (
        "2 of 4 slopes clearly mean ageing; were there none, about 0.1 would by chance. The "
        "oracle's recall@1: −0.010 [−0.020, +0.000] per 100 days."
    )
    none = findings.slopes_counted(slopes({"sci": (1.0, NAN, NAN)}), [("distance", "auroc")])
    assert sentence(none) == "There are too few test sequences for any slope's interval."


def test_confounders_say_what_else_differs_and_no_nan(study: Study) -> None:
    def one(days: int, unseen: float, turned: float) -> Result:
        return numbered("sci", days, queries=(10, 10), unseen=(unseen, 0), turned_share=(turned, 0))

    found = findings.confounders(
        reporting(study, [one(20, 1, 0.1), one(120, 2, 0.1), one(220, 3, 0.1)])
    )
    assert found.values["unseen"] == {"first": 0.1, "last": 0.3, "correlation": pytest.approx(1.0)}
    text = sentence(found)
    assert (
        "queries are 10 % of the first sequence and 30 % of the last (correlation with the days "
        "+1.00), which AUC" in text
    )
    assert "training are 10 % of the first sequence and 10 % of the last, which" in text
    blind = sentence(findings.confounders(reporting(study, [one(20, 10, NAN), one(120, 10, NAN)])))
    assert "than training are a share not known, as no query is seen, which" in blind
    assert "nan" not in blind
    assert "unseen queries are 20 % of the one test sequence, which" in sentence(
        findings.confounders(reporting(study, [one(20, 2, 0)]))
    )


def near(change: str, seen: int, value: float, low: float, high: float) -> list[dict[str, Any]]:
    place = {"method": "sci", "change": change, "level": 25.0}
    return [
        place | row("seen", "cells", seen),
        place | row("recall_at_1", "cells", value, low, high),
    ]


def test_near_changes_compare_the_nearest_band_with_enough_queries() -> None:
    names = {25.0: "0–25 m", np.inf: "over 25 m"}
    rows = table(
        [*near("change shown", 40, 0.5, 0.4, 0.6), *near("change to come", 50, 0.8, 0.7, 0.9)]
    )
    assert sentence(findings.near_changes(rows, "recall_at_1", names, 30)) == (
        "recall@1, by cells, 0–25 m away (40 and 50 seen queries), where a change shows against "
        "where one is to come: `sci` 0.500 against 0.800 (clearly lower)."
    )
    few = findings.near_changes(rows, "recall_at_1", names, 41)
    assert (
        sentence(few)
        == "recall@1: too few seen queries near changes, or near those to come, to say anything."
    )
    seen = [
        {"sequence": name} | row("seen_near_a_change", "cells", n)
        for name, n in (("2012-02-04-10-00-00", 3), ("2012-06-15", 1))
    ]
    changes = [row("construction_changes", "", 1), row("demolition_changes", "", 0)]
    found = findings.changes_counted(table([*seen, *changes]), ("construction", "demolition"), 50.0)
    assert sentence(found) == (
        "1 construction and 0 demolitions show in the test sequences, and 4 seen queries lie "
        "within 50 m of one, 3 of them on 2012-02-04."
    )
    assert ", and 0 seen queries lie within 50 m of one." in sentence(
        findings.changes_counted(table(changes), ("construction",), 50.0)
    )


def test_sizes_of_cells_have_a_trend_and_a_best_model_each() -> None:
    values = {
        "sci": [[0.5, 0.6], [0.7, 0.9]],
        "m2dp": [[0.5, 0.8], [0.4, 0.7]],
        "sad": [[0.5, 0.5], [0.4, 0.6]],
    }
    found = findings.trend(values, "AUC", (5.0, 10.0))
    rises, falls = (
        [(one["model"], one["mean"]) for one in way["models"]] for way in found.values["ways"]
    )
    assert (rises, falls) == ([("sci", pytest.approx(0.25))], [("m2dp", pytest.approx(-0.1))])
    assert sentence(found) == (
        "From 5 to 10 m, AUC rises on every sequence for 1 of 3 methods (`sci` +0.250) and falls "
        "on every sequence for 1 of 3 methods (`m2dp` −0.100)."
    )
    assert sentence(findings.trend({"sad": values["sad"]}, "AUC", (5.0, 10.0))).endswith(
        "for none of 1 method."
    )
    assert sentence(findings.best_at_each_size(values, "AUC", (5.0, 10.0))) == (
        "Highest mean AUC: `m2dp` at 5 m (0.650), `sci` at 10 m (0.800)."
    )


@pytest.mark.parametrize(
    ("models", "text"),
    [
        (1, "Turned, `sci` has the highest AUC top-1 by cells (0.750 ± 0.071)."),
        (2, "(0.750 ± 0.071); next `a` 0.350 (−0.400, clear)."),
        (
            4,
            "(0.750 ± 0.071); next `a` 0.350 (−0.400, clear), `b` 0.250 (−0.500, clear), `c` "
            "0.150 (−0.600, clear).",
        ),
    ],
)
def test_the_leader_is_ahead_of_the_next_three(models: int, text: str) -> None:
    starts = {"sci": 0.7, "a": 0.3, "b": 0.2, "c": 0.1, "d": 0.0}
    some = [*starts][: models + (models == 4)]  # a fifth is left out
    given = compared({(m, TURNED): [[[starts[m]], [starts[m] + 0.1]]] for m in some}, {})
    assert sentence(cases.leader(given, TURNED, AUC)).endswith(text)
    assert (
        sentence(cases.leader(given, DRIVEN, AUC))
        == "As driven, no model has a number for AUC top-1 by cells."
    )


def test_who_keeps_its_auc_is_named_first() -> None:
    assert sentence(cases.kept(COMPARED, TURNED)) == (
        "Turned, `sci-4way` (99 %), `sci_ring` (95 %) keep their AUC by cells (95 % of it or "
        "more); `sci` keeps least, 38 % (0.300 instead of 0.800)."
    )
    built = Kind("construction", 2.0, True)
    assert sentence(cases.kept(BUILT, built)).startswith(
        "With 2 new walls and shadow, `m2dp` (100 %) keeps its AUC"
    )
    lost = compared({("sci", DRIVEN): [[[0.8]]], ("sci", TURNED): [[[0.4]]]}, {})
    assert (
        sentence(cases.kept(lost, TURNED))
        == "Turned, no model keeps 95 % of its AUC by cells; `sci` keeps most, 50 %."
    )
    even = compared(
        {(m, kind): [[[0.8]]] for m in ("sci", "a", "b") for kind in (DRIVEN, TURNED)}, {}
    )
    assert (
        "`sci` (100 %), `a` (100 %), `b` (100 %) keep their AUC by cells (95 % of it or more); "
        "`b` keeps least" in sentence(cases.kept(even, TURNED))
    )
    nothing = compared({("sci", DRIVEN): [[[NAN]]], ("sci", TURNED): [[[NAN]]]}, {})
    assert sentence(cases.kept(nothing, TURNED)) == "Turned, no model has an AUC to keep."


def test_other_findings_on_cases() -> None:
    one = Kind("demolition", 60.0)
    other = Kind("construction", 1.0)
    assert sentence(cases.nearly_always(COMPARED, TURNED)).startswith(
        "By distance and turned, none of 3 models are right at 95 %"
    )
    right = compared(
        {("sci", one): [[[0.97]]], ("a", one): [[[0.5]]]}, {}, median_heading_error_deg=2.0
    )
    assert sentence(cases.nearly_always(right, one)) == (
        "By distance and with 60° removed, 1 of 2 models is right at 95 % of the seen queries or "
        "more (`sci`)."
    )
    assert sentence(cases.heading_errors(right, one)).endswith(
        "with 60° removed: `sci` 2.0°, `a` 2.0°."
    )
    assert (
        sentence(cases.heading_errors(compared({("sci", one): [[[NAN]]]}, {}), one))
        == "No model gives a heading."
    )
    chance = cases.chance(COMPARED, TURNED)
    assert sentence(chance).startswith("Turned, a model's AUC deviates by 0.0")
    assert [one["name"] for one in chance.values["deviations"]] == ["repeat", "seed", "sequence"]
    assert sentence(cases.chance(right, one)) == ""
    (shadows,) = cases.shadows(BUILT)
    assert (
        sentence(shadows)
        == "Hiding what lies behind 2 new walls changes the AUC by −0.150 on average over the models, downwards for 1 of 2."
    )
    assert cases.shadows(compared({("sci", other): [[[0.5]]]}, {})) == []
    named = dict(zip(DAYS[:2], ("one", "two"), strict=True))
    assert sentence(cases.best_on_each(COMPARED, named)) == (
        "Highest recall@1 by cells: one: `sci_ring` 0.900, then `sci` 0.800; two: `sci` 0.800, "
        "then `sci-4way` 0.800."
    )


def ways(turned: Mapping[str, float], driven: Mapping[str, float], sequences: int = 2) -> Finding:
    """The finding on N-way training, of models with these AUCs on every sequence."""
    values = {
        (m, kind): [[[auc]] * sequences]
        for kind, each in ((DRIVEN, driven), (TURNED, turned))
        for m, auc in each.items()
    }
    return cases.n_ways(compared(values, {"sci": 1, "sci-4way": 4, "sci-8way": 8}), TURNED)


@pytest.mark.parametrize(
    ("four", "eight", "as_driven", "sequences", "verdict"),
    [
        (0.79, 0.8, 0.8, 2, "both show here"),
        (0.69, 0.7, 0.7, 2, "the first shows here, the second does not"),
        (0.7, 0.8, 0.8, 2, "the second shows here, the first does not"),  # 88 % alone are kept
        (
            0.77,
            0.9,
            0.8,
            2,
            "the second shows here, the first does not",
        ),  # eight ways clearly add to the 96 %
        (0.5, 0.6, 0.7, 2, "neither shows here"),
        (0.79, 0.8, 0.8, 1, "one sequence does not decide it"),
    ],
)
def test_four_ways_suffice_or_not(
    four: float, eight: float, as_driven: float, sequences: int, verdict: str
) -> None:
    driven = {"sci": 0.8, "sci-4way": as_driven, "sci-8way": 0.8}
    text = sentence(ways({"sci": 0.3, "sci-4way": four, "sci-8way": eight}, driven, sequences))
    assert (
        f"and keeps normal performance: {verdict}. Turned, it keeps {four / as_driven:.0%}".replace(
            "%", " %"
        )
        in text
    )
    assert text.endswith(
        f"1-way 0.300 of 0.800, 4-way {four:.3f} of {as_driven:.3f}, 8-way {eight:.3f} of 0.800."
    )
    assert "more ways add: 8-way" in text
    assert "as driven, against fewer ways: 1-way" in text


def test_four_ways_are_not_tested_without_others() -> None:
    assert "this study does not test it" in sentence(ways({"sci": 0.3}, {"sci": 0.8}))


def test_a_section_says_what_it_rests_on(study: Study) -> None:
    assert sentence(findings.scope(study, 2, 3, 5)) == (
        "Measured in simulated campus, `10m` cells, 2 test sequences, 5 repeats, up to 3 seeds a "
        "model, budget `tiny`."
    )
    assert "1 test sequence, one seed a model" in sentence(findings.scope(study, 1, 1))
