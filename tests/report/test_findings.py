"""Findings: their numbers worked out by hand on small tables, their sentences kept as snapshots."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from syrupy.assertion import SnapshotAssertion

from pipeline.evaluation.caveats import CAVEATS, DEGENERATE
from pipeline.evaluation.rows import AGAINST, NEAR_CHANGE, row, table
from pipeline.report import findings
from pipeline.report.comparison import AUC, UNPERTURBED_KIND, Kind
from pipeline.report.findings import Finding
from pipeline.report.render import percent, sentence
from pipeline.report.result import Result
from pipeline.report.study import StudyResults, TrainingRecord
from tests.report.figures.made import BUILT, COMPARED, DAYS, ONE, TURNED, compared, rows_of

NAN = np.nan
DAYS_AFTER = (20, 152)


def reporting(study: StudyResults, results: Sequence[Result], rounds: int = 0) -> StudyResults:
    """The study, but with these results of its models."""
    changed = replace(study)
    names = list(dict.fromkeys(result.model for result in results))
    learned = TrainingRecord(
        {"budget": "0.03"}, {"loss": np.ones(rounds)} if rounds else {}, None, 1.0
    )
    vars(changed).update(
        results=list(results),
        families=names,
        models=dict.fromkeys(names, learned),
        distance=study.distance,
    )
    return changed


def numbered(model: str, days: int, **cells_and_distance: tuple[float, float]) -> Result:
    """A result of a model, with these numbers by cells and by distance."""
    numbers = dict(ONE[0].numbers)
    for name, values in cells_and_distance.items():
        numbers |= {
            (by, name): (value, NAN, NAN)
            for by, value in zip(("cells", "distance"), values, strict=True)
        }
    return replace(
        ONE[0],
        model=model,
        sequence=DAYS[0] if days < 100 else DAYS[1],
        days=days,
        rows=rows_of(numbers),
    )


def test_the_answer_names_the_best_model_by_distance_and_how_the_others_fare(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    best = [
        numbered("sci", 20, recall_at_1=(0.5, 0.9)),
        numbered("sci", 152, recall_at_1=(0.4, 0.7)),
    ]
    others = [
        numbered(model, 20, recall_at_1=(0.9, share))
        for model, share in (("a", 0.5), ("b", 0.4), ("c", 0.3))
    ]
    finding = findings.answer(reporting(study, [*others[:1], *best], rounds=2))
    assert finding.values["first"]["model"] == "sci"
    assert finding.values["first"]["mean"] == {"cells": 0.45, "distance": pytest.approx(0.8)}
    assert sentence(finding) == snapshot(name="three models")
    two_others = findings.answer(reporting(study, [*best, *others[:2]]))
    assert sentence(two_others) == snapshot(name="one other than the next")
    three_others = findings.answer(reporting(study, [*best, *others]))
    assert sentence(three_others) == snapshot(name="several others than the next")


def test_the_answer_says_what_the_threshold_reaches(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    answers_nothing = numbered(
        "sci",
        20,
        recall_at_1=(0.5, 0.9),
        precision_at_threshold=(NAN, NAN),
        recall_at_threshold=(0.0, 0.0),
    )
    finding = findings.answer(reporting(study, [answers_nothing]))
    assert sentence(finding) == snapshot(name="nothing is answered")
    result = numbered("sci", 20, recall_at_1=(0.5, 0.9))
    validation_precision = {("distance", "validation_precision"): (0.731, NAN, NAN)}
    misses_target = replace(result, rows=rows_of(result.numbers | validation_precision))
    finding = findings.answer(reporting(study, [misses_target]))
    assert sentence(finding) == snapshot(name="the target precision is missed")


def test_a_share_that_is_not_known_is_a_dash() -> None:
    assert percent(NAN) == "–"


def test_caveats_are_said_once_where_both_protocols_share_them(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    def result_with(model: str, sequence: int, **caveats: tuple[float, float]) -> Result:
        result = numbered(model, 20, blind_recall_at_1=(0.2, 0.75), **caveats)
        numbers = {
            key: values
            for key, values in result.numbers.items()
            if key[1] in caveats or key[1] not in (DEGENERATE, *CAVEATS)
        }
        about = {"sequence": DAYS[sequence], "days": DAYS_AFTER[sequence]}
        return replace(result, rows=rows_of(numbers), **about)

    misses_target = result_with("a", 0, caveat_less_precise=(0.731, 0.731))
    (caveat,) = findings.caveats(reporting(study, [misses_target]))
    assert sentence(caveat) == snapshot(name="the target precision is missed")
    degenerate_by_distance = result_with("b", 0, degenerate=(NAN, 1.0))
    del degenerate_by_distance.numbers["cells", DEGENERATE]
    results = [
        result_with("sci", 0),
        result_with("a", 0, caveat_one_answer=(0.8, 0.8), caveat_no_threshold=(1, 1)),
        degenerate_by_distance,
        result_with("b", 1),
    ]
    caveats = findings.caveats(reporting(study, results))
    assert [sentence(caveat) for caveat in caveats] == snapshot(name="by both, and by distance")


def against(
    sequence: str, recall: tuple[float, float], auc: tuple[float, float]
) -> list[dict[str, Any]]:
    """Rows of m2dp against sci on one sequence: differences and p of recall and of exact AUC."""
    place = {"method": "m2dp", "ask": AGAINST, "of": "sci", "sequence": sequence}
    rows = []
    for name, (difference, p) in {"recall_at_1": recall, "auc_exact_top1": auc}.items():
        rows.append(place | row(f"{name}_difference", "cells", difference))
        rows.append(place | row(f"{name}_difference_p", "cells", p))
    return rows


def test_the_paired_test_says_where_a_model_is_better_and_where_worse(
    snapshot: SnapshotAssertion,
) -> None:
    rows = [
        *against("2012-02-04", (0.3, 0.01), (0.1, 0.2)),
        *against("2012-06-15", (-0.1, 0.04), (-0.2, 0.3)),
    ]
    (finding,) = findings.paired(table(rows), "cells")
    recall = finding.values["verdicts"][0]
    assert recall["mean"] == pytest.approx(0.1)
    assert recall["better"] == ["2012-02-04"]
    assert recall["worse"] == ["2012-06-15"]
    assert sentence(finding) == snapshot
    assert findings.paired(table(rows), "distance") == []


def test_novelties_say_which_kind_tells_unseen_from_seen_best(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    # ONE's entropy ranks 9 of 10 pairs right, its energy all; energy's threshold accepts the five
    # seen, three of them right.
    (finding,) = findings.novelties(reporting(study, ONE), "cells")
    assert [(entry["kind"], entry["auroc"]) for entry in finding.values["ranked"]] == [
        ("energy", 1.0),
        ("entropy", pytest.approx(0.9)),
    ]
    assert finding.values["ahead"] == 2
    assert finding.values["nearest"]["kind"] == "energy"
    assert sentence(finding) == snapshot(name="a kind that is not in use")


def test_novelties_say_so_where_the_kind_in_use_is_best_or_alone(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    result = replace(ONE[0], evaluation=replace(ONE[0].evaluation, kinds=("cost", "ratio")))
    by_cells = result.evaluation.cells
    cost_first = replace(by_cells, rejection=by_cells.rejection[::-1])

    def sentences(kinds: tuple[str, ...], judgements: Sequence[Any], protocol: str) -> list[str]:
        evaluation = replace(result.evaluation, kinds=kinds, judgements=tuple(judgements))
        reported = reporting(study, [replace(result, evaluation=evaluation)])
        return [sentence(finding) for finding in findings.novelties(reported, protocol)]

    both = (cost_first, result.evaluation.distance)
    assert sentences(("cost", "ratio"), both, "cells") == snapshot(name="the kind in use")
    cost_alone = replace(cost_first, rejection=cost_first.rejection[:1])
    assert sentences(("cost",), (cost_first, cost_alone), "distance") == snapshot(name="one kind")
    unknown = replace(cost_alone, rejection=np.full_like(cost_alone.rejection, NAN))
    assert sentences(("cost",), (cost_first, unknown), "distance") == []


def slopes(
    of: Mapping[str, tuple[float, float, float]], number: str = "auroc", protocol: str = "distance"
) -> pd.DataFrame:
    return table(
        [
            {"method": model} | row(f"{number}_per_100_days", protocol, *values)
            for model, values in of.items()
        ]
    )


def test_ageing_names_who_clearly_loses_and_what_cannot_be_ruled_out(
    snapshot: SnapshotAssertion,
) -> None:
    rows = slopes(
        {"sci": (-0.1, -0.15, -0.05), "m2dp": (0.01, -0.02, 0.04), "oracle": (-0.5, -0.6, -0.4)}
    )
    retraining = table(
        [{"method": "sci"} | row("auroc_retrain_after_days", "distance", 95.0, 60.0, 190.0)]
    )
    finding = findings.ageing(
        pd.concat([rows, retraining]), "AUROC, by distance", "distance", "auroc", 90
    )
    assert [entry["model"] for entry in finding.values["falls"]] == ["sci"]
    assert finding.values["worst"] == {"model": "m2dp", "slope": -0.02}
    assert sentence(finding) == snapshot(name="one falls, the others may")
    falling = pd.concat([slopes({"sci": (-0.1, -0.15, -0.05)}), retraining])
    assert sentence(findings.ageing(falling, "A", "distance", "auroc", 287)) == snapshot(
        name="one alone falls"
    )
    rising = slopes({"sci": (0.1, 0.05, 0.15)})
    assert sentence(findings.ageing(rising, "A", "distance", "auroc", 287)) == snapshot(
        name="none falls"
    )
    too_few = slopes({"sci": (-0.1, NAN, NAN)})
    assert sentence(findings.ageing(too_few, "A", "distance", "auroc", 287)) == snapshot(
        name="too few days"
    )


def test_newer_says_to_which_models_seen_places_look_newer(snapshot: SnapshotAssertion) -> None:
    newer_to_sci = {"sci": (3.0, 1.0, 5.0), "m2dp": (1.0, -1.0, 3.0)}
    for name, slope in {
        "to one": newer_to_sci,
        "to none": {"m2dp": (1.0, -1.0, 3.0)},
        "too few days": {"sci": (1.0, NAN, NAN)},
    }.items():
        finding = findings.newer(slopes(slope, "novelty_percentile"))
        assert sentence(finding) == snapshot(name=name)


def test_slopes_are_counted_with_the_number_expected_by_chance(snapshot: SnapshotAssertion) -> None:
    rows = slopes({"sci": (3.0, 1.0, 5.0), "m2dp": (1.0, -1.0, 3.0)}, "novelty_percentile")
    oracle_row = row("recall_at_1_same_heading_per_100_days", "cells", -0.01, -0.02, 0.0)
    oracle = table([{"method": "oracle"} | oracle_row])
    falls = slopes({"sci": (-0.1, -0.2, -0.01), "m2dp": (0, -1, 1)}, "auc_top1", "cells")
    finding = findings.slopes_counted(
        pd.concat([rows, falls, oracle]),
        [("distance", "novelty_percentile"), ("cells", "auc_top1")],
    )
    assert finding.values["worse"] == 2
    assert finding.values["number"] == 4
    assert finding.values["by_chance"] == pytest.approx(0.1)
    assert sentence(finding) == snapshot(name="two of four")
    too_few = findings.slopes_counted(slopes({"sci": (1.0, NAN, NAN)}), [("distance", "auroc")])
    assert sentence(too_few) == snapshot(name="too few days")


def test_confounders_say_what_else_differs_and_no_nan(
    study: StudyResults, snapshot: SnapshotAssertion
) -> None:
    def result(days: int, unseen: float, turned: float) -> Result:
        return numbered("sci", days, queries=(10, 10), unseen=(unseen, 0), turned_share=(turned, 0))

    more_unseen = [result(20, 1, 0.1), result(120, 2, 0.1), result(220, 3, 0.1)]
    finding = findings.confounders(reporting(study, more_unseen))
    assert finding.values["unseen"] == {
        "first": 0.1,
        "last": 0.3,
        "correlation": pytest.approx(1.0),
    }
    assert sentence(finding) == snapshot(name="more are unseen")
    none_seen = findings.confounders(reporting(study, [result(20, 10, NAN), result(120, 10, NAN)]))
    assert "nan" not in sentence(none_seen)
    assert sentence(none_seen) == snapshot(name="none is seen")
    one_day = findings.confounders(reporting(study, [result(20, 2, 0)]))
    assert sentence(one_day) == snapshot(name="one day")


def near(change: str, seen: int, value: float, low: float, high: float) -> list[dict[str, Any]]:
    place = {"method": "sci", "ask": NEAR_CHANGE, "of": change, "at": 25.0}
    return [
        place | row("seen", "cells", seen),
        place | row("recall_at_1", "cells", value, low, high),
    ]


def test_near_changes_compare_the_nearest_band_with_enough_queries(
    snapshot: SnapshotAssertion,
) -> None:
    names = {25.0: "0–25 m", np.inf: "over 25 m"}
    rows = table([*near("shown", 40, 0.5, 0.4, 0.6), *near("to come", 50, 0.8, 0.7, 0.9)])
    for least_queries, name in ((30, "enough queries"), (41, "too few queries")):
        finding = findings.near_changes(rows, "recall_at_1", names, least_queries)
        assert sentence(finding) == snapshot(name=name)


def test_changes_and_the_queries_near_them_are_counted(snapshot: SnapshotAssertion) -> None:
    seen = [
        {"sequence": sequence} | row("seen_near_a_change", "cells", count)
        for sequence, count in (("2012-02-04-10-00-00", 3), ("2012-06-15", 1))
    ]
    changes = [row("construction_changes", "", 1), row("demolition_changes", "", 0)]
    some = findings.changes_counted(table([*seen, *changes]), ("construction", "demolition"), 50.0)
    assert sentence(some) == snapshot(name="queries near a change")
    none = findings.changes_counted(table(changes), ("construction",), 50.0)
    assert sentence(none) == snapshot(name="no query near a change")


def test_sizes_of_cells_have_a_trend_and_a_best_model_each(snapshot: SnapshotAssertion) -> None:
    values = {
        "sci": [[0.5, 0.6], [0.7, 0.9]],
        "m2dp": [[0.5, 0.8], [0.4, 0.7]],
        "sad": [[0.5, 0.5], [0.4, 0.6]],
    }
    trend = findings.trend(values, "AUC", (5.0, 10.0))
    rises, falls = trend.values["ways"]
    assert [(entry["model"], entry["mean"]) for entry in rises["models"]] == [
        ("sci", pytest.approx(0.25))
    ]
    assert [(entry["model"], entry["mean"]) for entry in falls["models"]] == [
        ("m2dp", pytest.approx(-0.1))
    ]
    assert sentence(trend) == snapshot(name="one rises and one falls")
    steady = findings.trend({"sad": values["sad"]}, "AUC", (5.0, 10.0))
    assert sentence(steady) == snapshot(name="none")
    best = findings.best_at_each_size(values, "AUC", (5.0, 10.0))
    assert sentence(best) == snapshot(name="the best at each size")


@pytest.mark.parametrize("models", [1, 2, 5])
def test_the_leader_is_ahead_of_the_next_three(models: int, snapshot: SnapshotAssertion) -> None:
    # of five models the last is left out
    starts = dict(zip(("sci", "a", "b", "c", "d"), (0.7, 0.3, 0.2, 0.1, 0.0), strict=True))
    given = compared(
        {(m, TURNED): [[[starts[m]], [starts[m] + 0.1]]] for m in [*starts][:models]}, {}
    )
    assert sentence(findings.leader(given, TURNED, AUC)) == snapshot


def test_without_queries_unperturbed_nobody_leads(snapshot: SnapshotAssertion) -> None:
    turned_alone = compared({("sci", TURNED): [[[0.7], [0.8]]]}, {})
    assert sentence(findings.leader(turned_alone, UNPERTURBED_KIND, AUC)) == snapshot


def test_who_keeps_its_auc_is_named_first(snapshot: SnapshotAssertion) -> None:
    assert sentence(findings.kept(COMPARED, TURNED)) == snapshot(name="two keep it")
    built = Kind("construction", 2.0, True)
    assert sentence(findings.kept(BUILT, built)) == snapshot(name="walls that hide what is behind")
    lost = compared({("sci", UNPERTURBED_KIND): [[[0.8]]], ("sci", TURNED): [[[0.4]]]}, {})
    assert sentence(findings.kept(lost, TURNED)) == snapshot(name="none keeps it")
    even = compared(
        {(m, kind): [[[0.8]]] for m in ("sci", "a", "b") for kind in (UNPERTURBED_KIND, TURNED)}, {}
    )
    assert sentence(findings.kept(even, TURNED)) == snapshot(name="all keep it")
    nothing = compared({("sci", UNPERTURBED_KIND): [[[NAN]]], ("sci", TURNED): [[[NAN]]]}, {})
    assert sentence(findings.kept(nothing, TURNED)) == snapshot(name="no AUC")


def test_who_is_nearly_always_right_and_how_far_headings_are_off(
    snapshot: SnapshotAssertion,
) -> None:
    removed = Kind("demolition", 60.0)
    assert sentence(findings.nearly_always(COMPARED, TURNED)) == snapshot(name="none is right")
    right = compared(
        {("sci", removed): [[[0.97]]], ("a", removed): [[[0.5]]]}, {}, median_heading_error_deg=2.0
    )
    assert sentence(findings.nearly_always(right, removed)) == snapshot(name="one is right")
    assert sentence(findings.heading_errors(right, removed)) == snapshot(name="two headings")
    headless = compared({("sci", removed): [[[NAN]]]}, {})
    assert sentence(findings.heading_errors(headless, removed)) == snapshot(name="no heading")
    assert sentence(findings.variation(right, removed)) == ""


def test_random_variation_is_reported_by_repeats_seeds_and_sequences(
    snapshot: SnapshotAssertion,
) -> None:
    variation = findings.variation(COMPARED, TURNED)
    names = [entry["name"] for entry in variation.values["deviations"]]
    assert names == ["repeat", "seed", "sequence"]
    assert sentence(variation) == snapshot


def test_shadows_of_walls_and_the_best_on_each_day(snapshot: SnapshotAssertion) -> None:
    (shadows,) = findings.shadows(BUILT)
    assert sentence(shadows) == snapshot(name="what walls hide")
    shadowless = compared({("sci", Kind("construction", 1.0)): [[[0.5]]]}, {})
    assert findings.shadows(shadowless) == []
    days = dict(zip(DAYS[:2], ("one", "two"), strict=True))
    assert sentence(findings.best_on_each(COMPARED, days)) == snapshot(name="the best on each day")


def ways(turned: Mapping[str, float], driven: Mapping[str, float], sequences: int = 2) -> Finding:
    """The finding on N-way training, of models with these AUCs on every sequence."""
    values = {
        (m, kind): [[[auc]] * sequences]
        for kind, each in ((UNPERTURBED_KIND, driven), (TURNED, turned))
        for m, auc in each.items()
    }
    return findings.n_ways(compared(values, {"sci": 1, "sci-4way": 4, "sci-8way": 8}), TURNED)


@pytest.mark.parametrize(
    ("four", "eight", "unperturbed", "sequences", "verdict"),
    [
        (0.79, 0.8, 0.8, 2, "both hold here"),
        (0.69, 0.7, 0.7, 2, "the first holds here, the second does not"),
        (0.7, 0.8, 0.8, 2, "the second holds here, the first does not"),  # 88 % alone are kept
        (
            0.77,
            0.9,
            0.8,
            2,
            "the second holds here, the first does not",
        ),  # eight ways clearly add to the 96 %
        (0.5, 0.6, 0.7, 2, "neither holds here"),
        (0.79, 0.8, 0.8, 1, "one sequence is too few to decide this"),
    ],
)
def test_four_ways_suffice_or_not(
    four: float, eight: float, unperturbed: float, sequences: int, verdict: str
) -> None:
    driven = {"sci": 0.8, "sci-4way": unperturbed, "sci-8way": 0.8}
    text = sentence(ways({"sci": 0.3, "sci-4way": four, "sci-8way": eight}, driven, sequences))
    assert f"and keeps normal performance: {verdict}. Turned, 4-way training keeps" in text
    kept_percent = f"{four / unperturbed:.0%}".replace("%", " %")
    assert f"keeps {kept_percent} of its AUC" in text
    assert text.endswith(
        f"1-way 0.300 and 0.800, 4-way {four:.3f} and {unperturbed:.3f}, 8-way {eight:.3f} and 0.800."
    )
    assert "more headings add" in text
    assert "unperturbed, its difference to fewer headings is" in text


def test_four_ways_are_not_tested_without_others() -> None:
    assert "this study cannot test this" in sentence(ways({"sci": 0.3}, {"sci": 0.8}))


def test_a_section_says_what_it_rests_on(study: StudyResults, snapshot: SnapshotAssertion) -> None:
    assert sentence(findings.scope(study, 2, 3, 5)) == snapshot(name="repeats and seeds")
    assert sentence(findings.scope(study, 1, 1)) == snapshot(name="one of each")
