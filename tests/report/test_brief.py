"""`brief` prints the results in a few lines, of which the ones that matter stay."""

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import ArtifactError
from pipeline.evaluation.rows import STRESS, row, table
from pipeline.report.brief import LINES, brief
from tests.studies.made import RECORDED
from tests.studies.made import study as made_study

TESTS = ["2012-02-04", "2013-04-05"]
CAMPUS = made_study(tests=TESTS)
ROBOT = made_study("robot", tests=TESTS, **RECORDED)


def results(
    name: str,
    methods: int = 1,
    degenerate: bool = False,
    within_m: float = 15.0,
    posed: int | None = None,
) -> pd.DataFrame:
    """Method number i is right .5 + i / 100 on the first day and a tenth less often on the last."""
    rows = []
    for i in range(methods):
        for days, sequence in ((20, "2012-02-04"), (446, "2013-04-05"), (440, "2013-03-16")):
            place = {"grid": "10m", "method": f"m{i}", "sequence": sequence, "days": days}
            place |= {"ask": STRESS, "of": "heavy"} if sequence == "2013-03-16" else {}
            share = 0.5 + i / 100 - (0.1 if days > 20 else 0)
            rows.append(place | row("recall_at_1", "distance", share))
            rows.append(place | row("recall_at_1", "cells", 0.123))
            rows.append(place | row("answered", "distance", 0.25))
            rows.append(place | row("precision_at_threshold", "distance", np.nan if i else 0.875))
            rows.append(place | row("validation_precision", "distance", 0.731 if i else 0.95))
            rows.append(place | row("target_precision", "distance", 0.9))
            for number, count in (("accepted", 40), ("accepted_wrong", 1), ("refused_wrong", 9)):
                rows.append(place | row(number, "distance", count))
            rows += [place | row("degenerate", "distance", 1.0)] if degenerate else []
            rows += [place | row("within_2m_5deg", "distance", share)] if i == posed else []
        rows.append({"grid": "10m", "method": f"m{i}"} | row("query_ms", "", 12.4))
    rows.append({"grid": "10m"} | row("correct_m", "distance", within_m))
    return table(rows, study=name, dataset=name)


def test_the_best_on_the_last_day_comes_first_and_each_number_stands_in_its_column() -> None:
    text = brief(results("campus", methods=2), {"campus": CAMPUS}, 200)
    title, above, heads, first, second, _ = text.split("\n")
    assert title == "campus, simulated: learned 2012-01-15, 2 test days, cells of 10 m"
    assert above.split() == ["within", "15", "m", "wrong", "wrong", "ones", "ms", "a"]
    words = ["2012-02-04", "2013-04-05", "accepted", "of", "those", "refused", "query"]
    assert heads.split() == words
    # of two days: 2 × 40 accepted, 2 × 1 wrong among them, 2 × 9 wrong ones refused
    assert first.split() == ["m1", "0.510", "0.410", "80", "2", "18", "of", "20", "12"]
    assert second.split() == ["m0", "0.500", "0.400", "80", "2", "18", "of", "20", "12"]
    assert max(map(len, text.split("\n"))) <= 78


def test_the_kept_precision_stands_beside_the_count_where_it_is_not_99() -> None:
    rows = results("campus", posed=0)
    for kept, accepted in ((0.99, "80"), (0.985, "80 (at .985)"), (np.nan, "80 (keeps none)")):
        place = {"grid": "10m", "method": "m0", "ask": "unperturbed"}
        kept_rows = [
            place | {"sequence": sequence, "days": days} | row("kept_precision", "distance", kept)
            for sequence, days in (("2012-02-04", 20), ("2013-04-05", 446))
        ]
        whole = pd.concat([rows, table(kept_rows, study="campus", dataset="campus")])
        (line,) = [
            line
            for line in brief(whole, {"campus": CAMPUS}, 200).split("\n")
            if line.startswith("m0")
        ]
        assert f" {accepted}  " in line


def test_where_nothing_was_timed_there_is_no_column_of_times() -> None:
    rows = results("campus")
    heads = brief(rows[rows["number"] != "query_ms"], {"campus": CAMPUS}, 200).split("\n")[2]
    assert heads.split() == ["2012-02-04", "2013-04-05", "accepted", "of", "those", "refused"]


def test_a_name_stays_whole_and_the_last_column_gives_way() -> None:
    rows = results("campus")
    rows["method"] = rows["method"].replace("m0", "scan_context_all")  # 16 letters; 14 were left
    rows = table(rows.to_dict("records"))
    _, _, heads, line, _ = brief(rows, {"campus": CAMPUS}, 200).split("\n")
    assert line.split()[0] == "scan_context_all"
    assert heads.split() == ["2012-02-04", "2013-04-05", "accepted", "of", "those", "refused"]
    assert len(line) <= 78


def test_models_with_poses_stand_apart_from_those_without() -> None:
    """m3 is better than m2, that than m1, and that than m0."""
    rows = results("campus", methods=4)
    recall = rows[(rows["number"] == "recall_at_1") & (rows["protocol"] == "distance")]
    poses = recall[recall["method"] == "m3"].assign(number="within_2m_5deg")
    rows = pd.concat([rows, poses], ignore_index=True)
    variant = {"m3": "pose", "m1": "short", "m0": "engaged"}
    rows["variant"] = rows["method"].map(variant).fillna("")
    ours = dict.fromkeys(("m3", "m2", "m1"), "sci_ring")
    rows["method"] = rows["method"].replace({**ours, "m0": "sad"})
    rows = table(rows.to_dict("records"))
    lines = brief(rows, {"campus": CAMPUS}, 200).split("\n")[3:]
    # m1, the other variant of the same method without poses, is not its best
    assert [line.split("  ")[0] for line in lines if line.strip()] == [
        "with poses",
        "sci_ring-pose",
        "without poses",
        "sci_ring",
        "sad-engaged",
    ]
    only_ours = rows[rows["method"] != "sad"]
    assert "without poses" not in brief(only_ours, {"campus": CAMPUS}, 200)


def test_many_methods_and_a_narrow_terminal_are_cut_and_say_so() -> None:
    tables = pd.concat([results("campus", methods=40), results("robot", methods=40)])
    lines = brief(tables, {"campus": CAMPUS, "robot": ROBOT}, 60).split("\n")
    assert len(lines) < LINES
    assert max(map(len, lines)) <= 60
    assert any("robot, recorded" in line for line in lines)
    assert sum("more" in line for line in lines) == 2
    assert {"m39", "m38"} <= {line.split()[0] for line in lines if line.split()}


def test_a_score_that_means_nothing_says_so_and_a_tolerance_is_named() -> None:
    text = brief(
        results("yard", degenerate=True, within_m=2.5),
        {"yard": made_study("yard", tests=TESTS, tolerance="2m")},
        80,
    )
    assert text.split("\n")[3].split()[:3] == ["m0", "degenerate", "degenerate"]
    assert "within 2.5 m" in text


def test_a_table_of_an_earlier_version_is_refused() -> None:
    rows = results("campus")
    with pytest.raises(ArtifactError, match="do not say how near is right; `dvc repro`"):
        brief(rows[rows["number"] != "correct_m"], {"campus": CAMPUS}, 80)


def test_a_study_of_viewpoints_alone_points_to_its_tables() -> None:
    assert brief(table([]), {"suburb": made_study("suburb", train="01 02")}, 80).startswith(
        "suburb, simulated: judged by viewpoints alone"
    )
