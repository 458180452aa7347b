"""Studies spelled out for dvc.yaml."""

import pytest
import yaml

from pipeline.errors import ConfigError
from pipeline.studies.expansion import expand, spelled_out
from pipeline.studies.names import text

ONE = {
    "world": "w",
    "source": "world",
    "heeds": "simulated",
    "root": "r",
    "submap": "single",
    "train": "a",
    "tests": ["b", "c"],
    "grids": ["5m", "10m"],
    "methods": [{"name": "sci", "view": "sc"}, {"name": "m2dp", "view": "cloud"}, {"name": "sc50", "view": "sc"}],
    "budget": "tiny",
    "question": "year",
}
OTHER = ONE | {"train": "b", "tests": ["d"], "grids": ["10m"], "methods": [{"name": "sci", "view": "sc"}]}
SEEN_FROM_ABOVE = {"name": "pfl", "view": "bird", "stage": "birdviews", "seeds": 2}
TURNED = OTHER | {"train": "e f", "methods": [SEEN_FROM_ABOVE], "question": "viewpoints"}


def test_every_stage_gets_one_instance_for_each_of_its_names() -> None:
    lists = expand({"one": ONE, "other": OTHER})
    counts = {name: len(members) for name, members in lists.items()}
    # drives 3 + 2; submaps 1 + 1; views 2 + 1 (two methods share one); labels 2 + 1; models 2 × 3 + 1; reports 2 + 1
    year = {"drives": 5, "submaps": 2, "views": 3, "labels": 3, "models": 7, "rankings": 7, "reports": 3, "published": 2}
    assert counts == year | {"events": 0, "birdviews": 0, "viewpoints": 0, "robustness": 0, "cells": 0}
    assert lists["models"]["one-5m-m2dp"] == {
        "dataset": "one",
        "grid": "5m",
        "method": "m2dp",
        "view": "cloud",
        "model": "m2dp",
        "learn": "budget=tiny",
        "budget": "tiny",
        "train": "a",
        "of": "/a.zarr",
    }
    assert lists["rankings"]["one-5m-m2dp"]["tests"] == "b c"
    assert lists["views"]["one-cloud"]["sequences"] == "a b c"


def test_a_study_of_viewpoints_trains_on_several_sequences_and_ranks_no_places() -> None:
    lists = expand({"turned": TURNED})
    counts = {name: len(members) for name, members in lists.items() if members}
    assert counts == {"drives": 3, "submaps": 1, "birdviews": 1, "labels": 1, "models": 2, "viewpoints": 1}
    assert lists["birdviews"]["turned-bird"]["sequences"] == "e f d"
    assert lists["labels"]["turned-10m"]["sequences"] == lists["models"]["turned-10m-pfl"]["train"] == "e f"
    assert lists["models"]["turned-10m-pfl"]["of"] == ""
    assert lists["models"]["turned-10m-pfl-seed1"]["learn"] == "budget=tiny method.seed=1"


def test_methods_that_look_at_bird_views_are_asked_about_viewpoints_beside_the_year() -> None:
    lists = expand({"one": ONE | {"methods": [*ONE["methods"], SEEN_FROM_ABOVE]}})
    assert list(lists["viewpoints"]) == ["one-5m", "one-10m"]
    assert list(lists["birdviews"]) == ["one-bird"]
    assert "one-5m-pfl" in lists["rankings"]


def test_robustness_adds_sequences_cells_variants_and_alterations() -> None:
    variants = {"4way": "method.n_way=4 method.epochs=100"}
    methods = [{"name": "sci", "view": "sc", "seeds": 2, "variants": variants}, {"name": "m2dp", "view": "cloud"}]
    asked = {"stress": {"x": "heavy"}, "cells": ["20m"], "robustness": {"turned": ["b"], "as_driven": ["x"]}}
    lists = expand({"one": OTHER | {"question": "robustness", "methods": methods, **asked}})
    # of the study's own cells each variant with each seed; of the further ones the methods as they are
    assert list(lists["models"]) == [
        "one-10m-sci",
        "one-10m-sci-seed1",
        "one-10m-sci-4way",
        "one-10m-sci-4way-seed1",
        "one-10m-m2dp",
        "one-20m-sci",
        "one-20m-m2dp",
    ]
    assert lists["models"]["one-10m-sci-4way-seed1"]["learn"] == "budget=tiny method.n_way=4 method.epochs=100 method.seed=1"
    assert list(lists["drives"]) == ["one-b", "one-d", "one-x"]
    assert lists["views"]["one-sc"]["sequences"] == lists["labels"]["one-20m"]["sequences"] == "b d x"
    assert {words["tests"] for words in lists["rankings"].values()} == {"d"}  # the year is told of its own tests alone
    assert list(lists["reports"]) == ["one-10m"]
    assert lists["robustness"]["one-10m-as_driven"] == {
        "grid": "10m",
        "dataset": "one",
        "alteration": "as_driven",
        "sequences": "x",
        "models": "all",
    }
    assert list(lists["robustness"]) == ["one-10m-turned", "one-10m-as_driven"]
    assert lists["cells"] == {"one": {"dataset": "one"}}


def test_a_study_without_a_question_asks_about_the_year() -> None:
    old = {name: word for name, word in ONE.items() if name != "question"}
    assert expand({"one": old}) == expand({"one": ONE})


def test_an_unknown_question_is_named() -> None:
    with pytest.raises(ConfigError, match="question=when: expected year, robustness or viewpoints"):
        expand({"one": ONE | {"question": "when"}})


def test_studies_do_not_mix() -> None:
    both, alone = expand({"one": ONE, "other": OTHER}), expand({"other": OTHER})
    for name, members in alone.items():
        assert members.items() <= both[name].items()


def test_the_file_holds_what_it_was_made_of() -> None:
    studies = {"one": ONE, "other": OTHER, "turned": TURNED}
    assert spelled_out(yaml.safe_load(text(studies))["benchmark"]) == studies


def test_lists_that_a_hand_left_behind_are_refused() -> None:
    benchmark = yaml.safe_load(text({"one": ONE}))["benchmark"]
    benchmark["studies"]["one"]["tests"].append("e")
    with pytest.raises(ConfigError, match="yearloc use"):
        spelled_out(benchmark)


def test_a_word_that_lacks_is_named() -> None:
    with pytest.raises(ConfigError, match="lacks budget"):
        text({"one": {key: value for key, value in ONE.items() if key != "budget"}})
