"""A study of conf/studies.yaml is checked where it is read, and written as it was read."""

from dataclasses import replace
from typing import Any

import pytest
import yaml

from pipeline.core.errors import ConfigError
from pipeline.studies.studies_file import refuse_unknown
from pipeline.studies.study import CellSize, Study, Tolerance
from tests.studies.made import CONF, RECORDED, TABLE, study

ALL: dict[str, Any] = {
    **TABLE,
    "train": "01 02",
    "learned": ["03"],
    "self_training": ["04"],
    "methods": [
        {
            "name": "sad",
            "view": "birdview",
            "code": "pipeline/methods/sad.py",
            "stage": "birdviews",
            "seeds": 3,
            "settings": {"h_max_m": 4.0},
            "variants": {"4way": "method.n_way=4"},
            "courses": {"days": ["frozen", "incremental"]},
        }
    ],
    "perturbed": {"turned": ["2012-02-04"]},
    "cells": ["5m"],
    "stress": {"05": "all reversed"},
    "poses": ["sad-4way"],
    "paths": ["filter"],
    "tolerance": "2m",
    "latency": False,
}


def test_what_was_read_is_written_again_in_the_order_of_the_file() -> None:
    tables = (ALL, TABLE | RECORDED, {**dict(reversed(ALL.items())), "tolerance": "15m"})
    for table in tables:
        asked = {key: value for key, value in table.items() if key != "experiment"}
        written = Study.of(CONF, "campus", table | {"methods": ALL["methods"]}).table()
        expected = {"experiment": table["experiment"], **asked, "methods": ALL["methods"]}
        assert yaml.safe_dump(written, sort_keys=False) == yaml.safe_dump(expected, sort_keys=False)


def test_what_a_hand_leaves_out_follows_from_conf() -> None:
    table = {key: value for key, value in TABLE.items() if key != "experiment"}
    by_hand = Study.of(CONF, "campus", table | {"methods": ["sad", {"name": "sci"}]})
    assert by_hand.experiment == "year"
    sad, sci = by_hand.methods
    assert (sad.view, sad.code, sad.stage) == ("birdview", "pipeline/methods/sad.py", "birdviews")
    assert (sci.view, sci.stage, sci.seeds) == ("scan_context_authors", "views", 1)
    assert by_hand.bird_view_methods == [sad]


def test_metres_are_those_of_the_files_that_a_study_names() -> None:
    metric = study(grids=["5m", "20m"], cells=["10m"])
    assert metric.all_grids == (CellSize("5m", 5.0), CellSize("20m", 20.0), CellSize("10m", 10.0))
    assert metric.tolerance == Tolerance("15m", 15.0)
    assert study(tolerance="2m").tolerance.correct_m == 2.0


def test_a_study_is_simulated_or_recorded_and_writes_both_keys() -> None:
    assert study().simulated
    recorded = study(**RECORDED)
    assert not recorded.simulated
    assert recorded.table().items() >= RECORDED.items()
    with pytest.raises(ConfigError, match="source=world and reads=reader: expected world and"):
        study(reads="reader")
    with pytest.raises(
        ConfigError, match=r"campus: source=readers: expected world, by `simulated`"
    ):
        refuse_unknown(CONF, replace(recorded, world="recorded"))


def test_a_model_answers_with_poses_and_along_paths_where_its_family_is_posed() -> None:
    sci = {"name": "sci", "seeds": 2, "variants": {"4way": "method.n_way=4"}}
    asked = study(methods=[sci, "m2dp"], poses=["sci-4way"], paths=["filter"])
    # sci, its second seed, 4way: three answers for each of two seeds, m2dp
    assert [model.name for model in asked.answerers] == [
        "sci",
        "sci-seed1",
        "sci-4way",
        "sci-4way-pose",
        "sci-4way-pose-filter",
        "sci-4way-seed1",
        "sci-4way-pose-seed1",
        "sci-4way-pose-filter-seed1",
        "m2dp",
    ]
    assert [model.name for model in asked.methods[0].families["sci"]] == ["sci", "sci-seed1"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            {"experiment": "when"},
            "experiment=when: expected year, robustness, viewpoints or lifelong",
        ),
        ({"train": 20120115}, "train=20120115: expected a list"),
        ({"tests": "2012-02-04"}, "tests=2012-02-04: expected a list"),
        ({"tests": [4]}, "tests[0]=4: expected a word; correct it, or `yearloc use campus` writes"),
        ({"tests": []}, "campus: not given: tests; correct it, or"),
        ({"grids": None}, "campus: not given: grids; correct it, or"),
        ({"grids": ["7m"]}, "campus: grid=7m: expected one of 10m, 20m, 2m, 5m"),
        ({"tolerance": "near"}, "campus: tolerance=near: expected one of 15m, 2m"),
        ({"perturbed": {"turned": "2012-02-04"}}, "perturbed.turned=2012-02-04: expected a list"),
        ({"latency": "no"}, "latency=no: expected true or false"),
        ({"posed": ["sci"]}, "the study has a key posed; expected some of experiment, world"),
        ({"methods": [7]}, "methods[0]=7: expected a table"),
        (
            {"methods": [{"view": "cloud"}]},
            "not given: methods[0].name, methods[0].code",
        ),
        ({"methods": [{"name": "sci", "seed": 2}]}, "a method has a key seed; expected some of"),
        ({"methods": [{"name": "sci", "seeds": 0}]}, "methods[0].seeds=0: expected a"),
        ({"methods": ["sco"]}, "methods=sco: expected some of afl"),
    ],
)
def test_a_slip_names_the_file_the_study_and_the_key(words: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        study(**words)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith("conf/studies.yaml: campus: ")
