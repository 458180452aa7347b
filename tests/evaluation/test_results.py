"""Tests of the table of results: the rows of an evaluation, and all artifacts of a study gathered
into one table."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError, LogError
from pipeline.evaluation import results
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.events import Bands
from pipeline.evaluation.numbers import MEASURES, NUMBERS, POSES
from pipeline.evaluation.plots import precision_recall, year
from pipeline.evaluation.results import ResultsTable
from pipeline.evaluation.rows import COLUMNS, case_text, evaluation_rows, table
from pipeline.evaluation.study_rows import AGEING, Answers, ageing_rows, paired_rows
from pipeline.evaluation.viewpoint_matches import NUMBERS as VIEWPOINT_NUMBERS
from pipeline.formats.changes import Change, write_changes
from pipeline.matching.rejection import NoveltyEvidence
from pipeline.perturbations import Case
from pipeline.report.study import against
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study
from tests.evaluation.made import BOOTSTRAP, LABELS, M2DP, SCI, evaluation, judged, write
from tests.studies.made import study as made_study

FEB = "february"
MAR = "march"
RAIN = "rain"
DAYS = {FEB: 20, MAR: 62, RAIN: 21}
STUDY = made_study(
    experiment="robustness",
    tests=[MAR, FEB],
    cells=["5m"],
    stress={RAIN: "wet"},
    methods=[{"name": "sci", "variants": {"4way": "method.n_way=4"}}, "sad"],
)
CASES = (Case(), Case("turned", repeat=1), Case("construction", 2.0, shadow=True))
WORSE = replace(SCI, places=SCI.places + np.array([[9, 0]] + [[0, 0]] * 6))
"""SCI, but with a wrong answer to the first query too: by cells 2 of 5 are right instead of 3."""
KNOWN, UNKNOWN = (
    dict.fromkeys(("entropy", "distance"), low + np.arange(3) / 10) for low in (0.1, 0.7)
)
EVIDENCE = NoveltyEvidence(np.ones(3, bool), KNOWN, UNKNOWN, np.arange(3))
"""All validation queries are answered right, and novelty separates seen from unseen ones."""
CURVES = {
    "curves/validation_error": np.array([0.5, 0.25, 0.375]),
    "curves/black_error": np.array([0.125, 0.125, 0.125]),
    "best_epoch": np.array(1),
}
"""The curves of a network that reconstructs images: three rounds, of which the second is kept."""


def gathering(root: Path, study: Study = STUDY) -> ResultsTable:
    return ResultsTable(Layout(root), study, Ageing(), Bands((25.0,)), 0.2)


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The artifacts of the study that `results` reads: of two methods and a variant, on two test
    sequences, unperturbed and perturbed, and a sequence of stress."""
    root = tmp_path_factory.mktemp("artifacts")
    for grid, model in (
        ("10m", "sci"),
        ("10m", "sci-4way"),
        ("10m", "sad"),
        ("5m", "sci"),
        ("5m", "sad"),
    ):
        learned = EVIDENCE.arrays() | (CURVES if model == "sad" else {})
        store.write_model(root / f"train/campus/{grid}/{model}.zarr.zip", learned, {})
        for name in (FEB, MAR, RAIN) if grid == "10m" else (FEB, MAR):
            ranking = (
                M2DP if model == "sad" else WORSE if name == MAR or model == "sci-4way" else SCI
            )
            cases = dict.fromkeys(
                CASES if (model, name) == ("sci", FEB) else CASES[:1],
                evaluation(DAYS[name], ranking),
            )
            write(root / f"evaluate/campus/{grid}/{model}/{name}.zarr", cases)
    (root / "events/campus").mkdir(parents=True)
    for name in (FEB, MAR):
        write_changes(root / f"events/campus/{name}.csv", [Change("construction", 1, 2, 0.0, 0.0)])
    turned = judged(np.array([[True, True], [True, False]]), np.array([[2.0, 1.0], [2.0, 1.0]]))
    store.write(root / f"viewpoints/campus/10m/sad/{FEB}.zarr", turned)
    return root


@pytest.fixture(scope="module")
def gathered(artifacts: Path) -> pd.DataFrame:
    return gathering(artifacts).table()


def value(frame: pd.DataFrame, number: str, **where: Any) -> float:
    """The value of the only row with this number and these columns."""
    for column, wanted in {"grid": "10m", "number": number, **where}.items():
        frame = frame[frame[column] == wanted]
    (result,) = frame["value"]
    return float(result)


def test_an_evaluation_gives_counts_numbers_kinds_of_novelty_and_calibration() -> None:
    one = replace(evaluation(), validation_precision=(0.731, 0.95), target_precision=0.9)
    result = {(row["of"], row["protocol"], row["number"]): row for row in evaluation_rows(one)}
    names = (
        "queries",
        "seen",
        "unseen",
        "threshold",
        "turned_share",
        "answered",
        "validation_precision",
        "target_precision",
        *(name for name in NUMBERS if name not in POSES),
    )
    novelties = one.kinds
    assert list(result) == [
        *(
            key
            for by in ("cells", "distance")
            for key in (
                *(("", by, name) for name in (*names, *one.caveats(by))),
                *(
                    (case, by, name)
                    for case in novelties
                    for name in (*MEASURES, "validation_precision")
                ),
            )
        ),
        *(("", "cells", name) for name in ("ece_raw", "ece")),
        *(("", "distance", name) for name in one.acceptance),
    ]
    expected = {
        name: result["", "cells", name]["value"] for name in (*names, "caveat_less_precise")
    }
    # Three of the five seen are right, one of them turned; entropy tells 9 of 10 pairs of seen and
    # unseen right, energy all.
    assert [expected[name] for name in names[:5]] == [7, 5, 2, 0.5, 1 / 5]
    assert expected["answered"] == 5 / 7  # novelties below .5: .1, .2, .3, .05, .4
    assert (
        expected["validation_precision"],
        expected["target_precision"],
        expected["caveat_less_precise"],
    ) == (
        0.731,
        0.9,
        0.731,
    )
    assert result["energy", "cells", "validation_precision"]["value"] == 0.95
    assert expected["recall_at_1"] == 3 / 5
    assert [result[case, "cells", "auroc"]["value"] for case in novelties] == pytest.approx(
        [0.9, 1.0]
    )
    assert result["energy", "cells", "auroc"]["ask"] == "novelty"
    recall = result["", "cells", "recall_at_1"]
    assert (recall["value"], recall["low"], recall["high"]) == one.number("cells", "recall_at_1")


def test_rows_of_a_perturbed_case_say_what_was_done_and_leave_novelties_out() -> None:
    result = list(evaluation_rows(evaluation(), Case("construction", 2.0, shadow=True, repeat=0)))
    others = Case(), Case("turned", repeat=3), Case("demolition", 60.0), Case("construction", 2.0)
    assert [*map(case_text, others)] == ["", "turned 3", "demolition 60°", "construction 2 walls"]
    parts = {(row["ask"], row["of"], row["at"], row["repeat"]) for row in result}
    assert parts == {("perturbed", "construction with shadow", 2.0, 0)}
    assert len(result) == 2 * (8 + len(NUMBERS) - len(POSES)) + 2 + len(evaluation().acceptance)


def test_the_table_holds_every_column_of_its_type_and_whose_study_it_is(
    gathered: pd.DataFrame,
) -> None:
    assert gathered.columns.tolist() == [*COLUMNS]
    kinds = {
        name: gathered[name].dtype.kind
        for name in ("simulated", "seed", "days", "at", "repeat", "value")
    }
    assert kinds == {
        "simulated": "b",
        "seed": "i",
        "days": "f",
        "at": "f",
        "repeat": "i",
        "value": "f",
    }
    assert gathered[["study", "dataset", "simulated"]].drop_duplicates().to_numpy().tolist() == [
        ["campus", "campus", True]
    ]
    assert table([]).dtypes.tolist() == table([{}]).dtypes.tolist()


def test_every_model_answers_every_sequence_it_is_asked_about(gathered: pd.DataFrame) -> None:
    driven = gathered[
        (gathered["number"] == "queries")
        & gathered["ask"].isin(["unperturbed", "stress"])
        & (gathered["protocol"] == "cells")
    ]
    result = set(
        map(
            tuple,
            driven[["grid", "method", "variant", "sequence", "days", "of"]].to_numpy().tolist(),
        )
    )
    tests = [(FEB, 20.0, ""), (MAR, 62.0, "")]
    models = (("sci", ""), ("sci", "4way"), ("sad", ""))
    asked = (*tests, (RAIN, 21.0, "wet"))
    own = [("10m", *model, *test) for model in models for test in asked]
    assert result == {
        *own,
        *(("5m", method, "", *test) for method in ("sci", "sad") for test in tests),
    }
    changes = gathered[gathered["ask"] == "perturbed"]
    asked = changes[["of", "at", "repeat"]].drop_duplicates()
    assert asked.to_numpy().tolist() == [["turned", 0, 1], ["construction with shadow", 2, 0]]
    assert changes[["method", "variant", "sequence"]].drop_duplicates().to_numpy().tolist() == [
        ["sci", "", FEB]
    ]
    validation = gathered[gathered["number"] == "validation_auc"]
    assert validation["value"].tolist() == pytest.approx([1.0] * 5)


def test_each_grid_says_how_near_is_right(gathered: pd.DataFrame) -> None:
    # As the evaluations were judged
    assert value(gathered, "correct_m", protocol="distance") == 12.0


def test_numbers_age_over_the_days(gathered: pd.DataFrame) -> None:
    # By cells 3/5 of day 20 and 2/5 of day 62: −.2 in 42 days, and .2 · 20 / 42 more on the day of
    # training.
    cells = {"method": "sci", "variant": "", "protocol": "cells"}
    assert value(gathered, "recall_at_1_per_100_days", **cells) == pytest.approx(-20 / 42)
    assert value(gathered, "recall_at_1_day_0", **cells) == pytest.approx(0.6 + 4 / 42)
    assert value(gathered, "recall_at_1_line", sequence=MAR, **cells) == pytest.approx(0.4)
    # The median entropy of the seen, .2, lies among .1 .2 .3 of the validation queries: above one
    # and level with one, in single precision.
    assert value(gathered, "novelty_percentile", sequence=FEB, method="sci") == pytest.approx(50.0)
    # The nearest anchor is in the right cell at four of five on both days; it is no method's.
    assert value(gathered, "recall_at_1", method="oracle", sequence=FEB) == pytest.approx(0.8)
    assert value(
        gathered, "recall_at_1_per_100_days", method="oracle", protocol="cells"
    ) == pytest.approx(0)
    lines = gathered[gathered["number"].str.endswith("_line")]
    assert set(
        zip(lines["protocol"], lines["number"].str.removesuffix("_line"), strict=True)
    ) == set(AGEING)
    assert set(lines["sequence"]) == {FEB, MAR}


def test_a_model_has_one_area_between_the_best_and_the_worst_day(gathered: pd.DataFrame) -> None:
    # F1 = 2 TP / (2 TP + FP + FN), and by cells FN are the rejected alone. Query 0, of novelty .1,
    # is right on the first day and wrong on the second. Above .1, .2 and .3 the days have 4/7 and
    # 2/6, above .4 they have 4/8 and 2/7, above .8 they have 6/9 and 4/8. The range is .05 to .9.
    area = (0.3 * (4 / 7 - 2 / 6) + 0.4 * (4 / 8 - 2 / 7) + 0.1 * (6 / 9 - 4 / 8)) / 0.85
    everywhere = {"sequence": "", "number": "awc_ft"}
    sci = everywhere | {"model": "sci"}
    assert value(gathered, protocol="cells", **sci) == pytest.approx(area)
    # By distance, query 0 is right on both days; the other models are the same on both.
    assert value(gathered, protocol="distance", **sci) == 0.0
    for model in ("sci-4way", "sad"):
        assert value(gathered, protocol="cells", **everywhere | {"model": model}) == 0.0


def test_methods_are_compared_with_the_first_on_the_same_queries(gathered: pd.DataFrame) -> None:
    # On day 20 by cells one is right at 0, 1 and 4, the other at 0 and 2, of five seen; later the
    # one is wrong at 0 too.
    tested = {
        "method": "sad",
        "ask": "against",
        "of": "sci",
        "protocol": "cells",
    }
    for sequence, expected in ((FEB, (-1 / 5, 1, 2)), (MAR, (0.0, 2, 2))):
        names = ("recall_at_1_difference", "only_this_right", "only_reference_right")
        assert [
            value(gathered, name, sequence=sequence, **tested) for name in names
        ] == pytest.approx(expected)
        assert 0 < value(gathered, "recall_at_1_difference_p", sequence=sequence, **tested) <= 1


def test_in_a_study_of_the_year_variants_are_compared_too(artifacts: Path) -> None:
    frame = gathering(artifacts, replace(STUDY, experiment="year")).table()
    variant = {"method": "sci", "variant": "4way", "protocol": "cells"}
    assert [
        value(frame, "recall_at_1_difference", sequence=name, **variant) for name in (FEB, MAR)
    ] == pytest.approx([-1 / 5, 0])
    assert set(against(frame, "cells")["model"]) == {"sci-4way", "sad"}


def test_queries_are_grouped_by_the_distance_to_real_changes(gathered: pd.DataFrame) -> None:
    # Something is built at the origin: the first three queries, 0, 10 and 20 m off, are within 25
    # m; of both days together the one that is better is right at 2 + 1 of six. No change is still
    # to come.
    near = {
        "method": "sci",
        "ask": "near a change",
        "of": "shown",
        "at": 25.0,
        "protocol": "cells",
    }
    assert (value(gathered, "seen", **near), value(gathered, "recall_at_1", **near)) == (
        6,
        pytest.approx(3 / 6),
    )
    far = near | {"of": "shown", "at": np.inf}
    assert value(gathered, "seen", **far) == 4
    assert (value(gathered, "construction_changes"), value(gathered, "demolition_changes")) == (
        1,
        0,
    )
    assert value(gathered, "seen_near_a_change", sequence=FEB) == 3


def test_methods_on_bird_views_are_asked_from_other_headings(
    artifacts: Path, gathered: pd.DataFrame
) -> None:
    # Two headings between two: 90° and 270°; both matches are right at the first, one of two at the
    # second.
    of = {"method": "sad", "sequence": FEB}
    assert [value(gathered, "accuracy", ask="viewpoint", at=deg, **of) for deg in (90, 270)] == [
        1.0,
        0.5,
    ]
    assert (
        value(gathered, "queries", ask="viewpoint", **of),
        value(gathered, "bytes_per_place", **of),
    ) == (2, 8224.0)
    assert set(gathered.loc[gathered["of"] == "heading", "number"]) == set(VIEWPOINT_NUMBERS)
    assert (
        value(gathered, "validation_error", method="sad", sequence="") == 0.25
    )  # the kept round's
    assert value(gathered, "black_error", method="sad", sequence="") == 0.125
    alone = gathering(artifacts, replace(STUDY, experiment="viewpoints")).table()
    assert set(alone["ask"]) == {"viewpoint"}


@pytest.mark.parametrize(
    "missing",
    [
        "evaluate/campus/10m/sci-4way/rain.zarr",
        "evaluate/campus/5m/sad/march.zarr",
        "train/campus/10m/sad.zarr.zip",
        "viewpoints/campus/10m/sad",
        "events/campus/march.csv",
    ],
)
def test_an_artifact_that_is_not_there_is_one_clear_line(
    artifacts: Path, tmp_path: Path, missing: str
) -> None:
    path = (artifacts / missing).rename(tmp_path / "away")
    try:
        with pytest.raises((ArtifactError, LogError), match=missing):
            gathering(artifacts).table()
    finally:
        path.rename(artifacts / missing)


def test_the_plots_show_each_methods_own_answers_to_the_tests(
    artifacts: Path, gathered: pd.DataFrame
) -> None:
    wide = year(gathered)
    shown = [
        [method, sequence, DAYS[sequence]] for method in ("sad", "sci") for sequence in (FEB, MAR)
    ]
    assert wide[["method", "sequence", "days"]].to_numpy().tolist() == shown
    assert wide["recall_at_1"].tolist() == pytest.approx([2 / 5, 2 / 5, 3 / 5, 2 / 5])
    curve = precision_recall(gathering(artifacts))
    assert curve.groupby(["method", "sequence"]).size().tolist() == [200] * 4
    none = precision_recall(gathering(artifacts, replace(STUDY, experiment="viewpoints")))
    assert none.columns.tolist() == curve.columns.tolist()


def unseen(days: int) -> Answers:
    """Three sequences of two methods, in the second of which no query is seen."""
    nowhere = replace(LABELS, places=np.full(7, -1), nearest_m=np.full(7, 99.0))
    labels = {"a": LABELS, "b": nowhere, "c": LABELS}
    on = {name: days * (i + 1) for i, name in enumerate(labels)}
    sci, sad = (
        {name: evaluation(on[name], ranking, labels[name]) for name in labels}
        for ranking in (SCI, M2DP)
    )
    return Answers({"sci": sci, "sad": sad}, {"sci": np.array([0.1, 0.3])})


@pytest.mark.parametrize(
    ("posed", "pairs"),
    [
        (["sad"], {"sad": "sci", "sad-pose": "sci"}),
        (["sci", "sad"], {"sad": "sci", "sci-pose": "sci", "sad-pose": "sci-pose"}),
    ],
)
def test_a_model_with_poses_is_tested_against_one_with_poses(
    posed: list[str], pairs: dict[str, str]
) -> None:
    answers = unseen(10)
    variants = {ModelName(method, posed=True): answers.evaluations[method] for method in posed}
    rows = against(table(paired_rows(replace(answers, variants=variants), BOOTSTRAP)), "cells")
    assert dict(zip(rows["model"], rows["of"], strict=True)) == pairs


def test_a_sequence_without_a_seen_query_has_no_number_and_the_line_passes_it_by() -> None:
    answers = unseen(10)
    frame = table([*ageing_rows(answers, Ageing()), *paired_rows(answers, BOOTSTRAP)], grid="10m")
    cells = {"method": "sci", "protocol": "cells"}
    # Through the first and the third
    assert value(frame, "recall_at_1_per_100_days", **cells) == 0.0
    assert value(frame, "recall_at_1_line", sequence="b", **cells) == pytest.approx(3 / 5)
    for gone in (
        value(frame, "novelty_percentile", method="sci", sequence="b"),
        value(frame, "recall_at_1", method="oracle", sequence="b"),
        *(
            value(frame, f"recall_at_1_difference{p}", method="sad", protocol="cells", sequence="b")
            for p in ("", "_p")
        ),
    ):
        assert np.isnan(gone)
    assert np.isnan(
        frame.loc[(frame["method"] == "sad") & (frame["number"] == "novelty_percentile"), "value"]
    ).all()
    one_day = table(ageing_rows(unseen(0), Ageing()))
    assert one_day.loc[one_day["number"].str.endswith("_line"), "value"].isna().all()
    assert not one_day["number"].str.contains("per_100_days").any()


@pytest.fixture
def written(gathered: pd.DataFrame, tmp_path: Path) -> Path:
    (tmp_path / "results/campus").mkdir(parents=True)
    gathered.to_csv(tmp_path / "results/campus/results.csv", index=False)
    return tmp_path


def test_every_digit_comes_back_from_the_csv(gathered: pd.DataFrame, written: Path) -> None:
    rng = np.random.default_rng(0)
    noisy = gathered.assign(
        value=rng.normal(0, 1, len(gathered)) * 10.0 ** rng.integers(-12, 12, len(gathered))
    )
    for frame in (gathered, noisy):
        frame.to_csv(written / "results/campus/results.csv", index=False)
        pd.testing.assert_frame_equal(
            results.read(Layout(written), {"campus": STUDY}), frame, check_exact=True
        )


def test_timings_are_read_with_the_table(gathered: pd.DataFrame, written: Path) -> None:
    (written / "latency/campus").mkdir(parents=True)
    timed = table([{"method": "sci", "number": "query_ms", "value": 3.0}], grid="10m")
    timed.to_csv(written / "latency/campus/10m.csv", index=False)
    result = results.read(Layout(written), {"campus": STUDY})
    assert len(result) == len(gathered) + 1
    assert value(result, "query_ms", method="sci") == 3.0
    assert result.dtypes.tolist() == gathered.dtypes.tolist()
    # Measured for another study
    assert (
        results.read(Layout(written), {"campus": replace(STUDY, latency=False)})["number"]
        .ne("query_ms")
        .all()
    )
    assert results.read(Layout(written), {}).empty
    with pytest.raises(
        ArtifactError, match=r"results.csv: no results yet; `dvc repro` gathers them"
    ):
        results.read(Layout(written), {"campus": STUDY, "town": STUDY})


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[: text.rindex(",") - 3],  # cut off within a row
        lambda text: text + "," * 40 + "\n",
        lambda text: text.replace("0.6", "many", 1),
        lambda text: text.replace(",ask,", ",other,", 1),
        lambda text: "\0\udcff" + text,
    ],
)
def test_a_damaged_table_is_refused(written: Path, damage: Callable[[str], str]) -> None:
    path = written / "results/campus/results.csv"
    path.write_bytes(damage(path.read_text()).encode(errors="surrogateescape"))
    with pytest.raises(
        ArtifactError, match=r"results.csv: not a table of results .*`dvc repro` rewrites it"
    ):
        results.read(Layout(written), {"campus": STUDY})


def test_rows_are_chosen_by_the_text_of_their_columns(gathered: pd.DataFrame) -> None:
    wanted = {
        "method": "sci,sad",
        "number": "recall_at_1",
        "ask": "unperturbed",
        "sequence": FEB,
        "protocol": "cells",
    }
    result = results.where(gathered, wanted)
    # Own, variant, own; and in other cells
    assert result["method"].tolist() == [
        "sci",
        "sci",
        "sad",
        "sci",
        "sad",
    ]
    assert len(results.where(result, {"seed": "0", "simulated": "True"})) == 5
    assert (
        len(results.where(result, {"days": "20"}))
        == len(results.where(result, {"days": "62,20.0"}))
        == 5
    )
    assert results.where(result, {"days": "2"}).empty
    assert results.where(result, {"method": "sc"}).empty
    with pytest.raises(
        ConfigError, match=r"--where place=sci: expected one of the columns study, dataset"
    ):
        results.where(gathered, {"place": "sci"})
