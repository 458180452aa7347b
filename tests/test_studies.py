"""Studies spelled out for dvc.yaml."""

import pytest
import yaml

from pipeline.benchmark import text
from pipeline.errors import ConfigError
from pipeline.studies import expand, spelled_out

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
}
OTHER = ONE | {"train": "b", "tests": ["d"], "grids": ["10m"], "methods": [{"name": "sci", "view": "sc"}]}


def test_every_stage_gets_one_instance_for_each_of_its_names() -> None:
    lists = expand({"one": ONE, "other": OTHER})
    counts = {name: len(members) for name, members in lists.items()}
    # drives 3 + 2; submaps 1 + 1; views 2 + 1 (two methods share one); labels 2 + 1; models 2 × 3 + 1; reports 2 + 1
    assert counts == {"drives": 5, "submaps": 2, "views": 3, "labels": 3, "models": 7, "reports": 3}
    assert lists["models"]["one-5m-m2dp"] == {
        "dataset": "one",
        "grid": "5m",
        "method": "m2dp",
        "view": "cloud",
        "budget": "tiny",
        "train": "a",
        "tests": "b c",
    }
    assert lists["views"]["one-cloud"]["sequences"] == "a b c"


def test_studies_do_not_mix() -> None:
    both, alone = expand({"one": ONE, "other": OTHER}), expand({"other": OTHER})
    for name, members in alone.items():
        assert members.items() <= both[name].items()


def test_the_file_holds_what_it_was_made_of() -> None:
    assert spelled_out(yaml.safe_load(text({"one": ONE, "other": OTHER}))["benchmark"]) == {"one": ONE, "other": OTHER}


def test_lists_that_a_hand_left_behind_are_refused() -> None:
    benchmark = yaml.safe_load(text({"one": ONE}))["benchmark"]
    benchmark["studies"]["one"]["tests"].append("e")
    with pytest.raises(ConfigError, match="yearloc use"):
        spelled_out(benchmark)


def test_a_word_that_lacks_is_named() -> None:
    with pytest.raises(ConfigError, match="lacks budget"):
        text({"one": {key: value for key, value in ONE.items() if key != "budget"}})
