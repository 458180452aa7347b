"""Studies are expanded to the lists of dvc.yaml: which instances each stage gets, with what."""

import shlex
from typing import Any

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser

from pipeline.core.errors import ConfigError
from pipeline.core.settings import filled
from pipeline.studies.expansion import LISTS, Lists, expand
from pipeline.studies.parts import MOST
from pipeline.studies.studies_file import check_lists, lists_text, studies_text
from pipeline.studies.study import Study
from tests.studies.made import CONF, study

SCI = {"name": "sci", "view": "sc", "code": "sci.py"}
M2DP = {"name": "m2dp", "view": "cloud", "code": "m2dp.py"}
DRIVE = {"world": "w", "source": "world", "reads": "simulated", "root": "r"}
METHODS = [SCI, M2DP, {"name": "sc50", "view": "sc", "code": "sc50.py"}]
ASKED = {
    "submap": "single",
    "train": "a",
    "tests": ["b", "c"],
    "grids": ["5m", "10m"],
    "budget": "tiny",
    "experiment": "year",
}
ONE: dict[str, Any] = {**DRIVE, **ASKED, "methods": METHODS}
OTHER = ONE | {"train": "b", "tests": ["d"], "grids": ["10m"], "methods": [SCI]}
SEEN_FROM_ABOVE = {"name": "pfl", "view": "bird", "code": "pfl", "stage": "birdviews", "seeds": 2}
TURNED = OTHER | {"train": "e f", "methods": [SEEN_FROM_ABOVE], "experiment": "viewpoints"}


def made(**tables: dict[str, Any]) -> dict[str, Study]:
    return {name: Study.of(CONF, name, table) for name, table in tables.items()}


def expanded(**tables: dict[str, Any]) -> Lists:
    """The lists of the studies of these tables, by name."""
    return expand(made(**tables))


def test_every_stage_gets_one_instance_for_each_of_its_names() -> None:
    lists = expanded(one=ONE, other=OTHER)
    counts = {name: len(members) for name, members in lists.items()}
    # drives 3 + 2; submaps 1 + 1; views 2 + 1 (two methods share one); labels 2 + 1; models 2 × 3 +
    # 1; latency 2 + 1
    models = dict.fromkeys(("models", "rankings", "evaluations"), 7)
    year = {
        "drives": 5,
        "submaps": 2,
        "views": 3,
        "labels": 3,
        **models,
        "latency": 3,
        "results": 2,
    }
    # nothing is perturbed: views 2 + 1; neither has viewpoints, events, further days or estimated
    # poses: 4 + 4
    further = {"published": 2, "report": 1, "absent": 11}
    assert counts == dict.fromkeys(LISTS, 0) | year | further
    place = {"dataset": "one", "grid": "5m", "train": "a", "of": "/a.zarr"}
    own = {
        "method": "m2dp",
        "model": "m2dp",
        "recipe": "method=m2dp",
        "code": "m2dp.py",
        "view": "cloud",
        "budget": "tiny",
    }
    assert lists["models"]["one-5m-m2dp"] == place | own
    assert lists["rankings"]["one-5m-m2dp"]["tests"] == "b c"
    assert lists["absent"]["one-cloud-perturbed"] == {"out": "artifacts/perturbed/one/cloud"}
    (word,) = shlex.split(lists["report"]["all"]["studies"])
    studies = yaml.safe_load(word.removeprefix("studies="))
    assert [study["name"] for study in studies] == ["one", "other"]
    assert lists["views"]["one-cloud"]["sequences"] == "a b c"


def test_poses_are_estimated_where_a_study_says_so() -> None:
    """The training day first, the others on its map; elsewhere the scans get an empty folder."""
    lists = expanded(one=ONE | {"slam": True}, other=OTHER)
    assert list(lists["slam"]) == ["one-a"]
    assert list(lists["slam_further"]) == ["one-b", "one-c"]
    assert lists["slam_further"]["one-b"]["train"] == "a"
    assert lists["drives"]["one-b"]["slam"] == "artifacts/slam/one/b.zarr"
    assert {drive["slam"] for name, drive in lists["drives"].items() if "other" in name} == {
        "artifacts/slam/other"
    }
    assert "one-slam" not in lists["absent"]
    assert lists["absent"]["other-slam"] == {"out": "artifacts/slam/other"}


def test_a_study_of_viewpoints_trains_on_several_sequences_and_ranks_no_places() -> None:
    lists = expanded(turned=TURNED)
    counts = {name: len(members) for name, members in lists.items() if members}
    once = dict.fromkeys(("submaps", "birdviews", "labels", "results", "report"), 1)
    assert counts == once | {"drives": 3, "models": 2, "viewpoints": 2, "absent": 5}
    assert lists["birdviews"]["turned-bird"]["sequences"] == "e f d"
    assert (
        lists["labels"]["turned-10m"]["sequences"]
        == lists["models"]["turned-10m-pfl"]["train"]
        == "e f"
    )
    assert lists["models"]["turned-10m-pfl"]["of"] == ""
    assert lists["models"]["turned-10m-pfl-seed1"]["recipe"] == "method=pfl method.seed=1"
    absent = ("slam", "evaluate", "events", "lifelong", "latency")
    assert lists["absent"] == {
        f"turned-{kind}": {"out": f"artifacts/{kind}/turned"} for kind in absent
    }


def test_stage_results_gets_the_whole_study_in_one_word() -> None:
    (study,) = made(turned=TURNED | {"stress": {"00": 'the driver\'s "detour"'}}).values()
    (word,) = shlex.split(expand({"turned": study})["results"]["turned"]["study"])
    name, _, value = word.partition("=")
    by_hydra = OverridesParser.create().parse_override(word).value()
    for table in (yaml.safe_load(value), by_hydra):
        assert filled(Study, table) == study
    assert name == "study"


def test_methods_that_look_at_bird_views_are_asked_about_viewpoints_beside_the_year() -> None:
    lists = expanded(one=ONE | {"methods": [*ONE["methods"], SEEN_FROM_ABOVE]})
    models = ("5m-pfl", "5m-pfl-seed1", "10m-pfl", "10m-pfl-seed1")
    assert list(lists["viewpoints"]) == [f"one-{model}" for model in models]
    assert list(lists["birdviews"]) == ["one-bird"]
    assert "one-5m-pfl" in lists["rankings"]


def test_a_variant_may_look_at_another_view() -> None:
    variants = {"other": "method.view=sc2", "own": "method.n_way=4"}
    asked = {"experiment": "robustness", "perturbed": {"turned": ["d"]}}
    lists = expanded(one=OTHER | {"methods": [SCI | {"variants": variants}], **asked})
    assert list(lists["views"]) == ["one-sc", "one-sc2"]
    assert list(lists["perturbed"]) == ["one-sc-turned", "one-sc2-turned"]
    for model, view in (("sci", "sc"), ("sci-own", "sc"), ("sci-other", "sc2")):
        assert lists["models"][f"one-10m-{model}"]["view"] == view
        assert lists["rankings"][f"one-10m-{model}"]["view"] == view
    assert lists["models"]["one-10m-sci-other"]["recipe"] == "method=sci method.view=sc2"


def test_robustness_adds_sequences_cells_variants_and_perturbations() -> None:
    variants = {"4way": "method.n_way=4 method.epochs=100"}
    methods = [SCI | {"seeds": 2, "variants": variants}, M2DP]
    asked = {
        "stress": {"x": "heavy"},
        "cells": ["20m"],
        "perturbed": {"turned": ["d"], "construction": ["d"]},
    }
    lists = expanded(one=OTHER | {"experiment": "robustness", "methods": methods, **asked})
    # of the study's own cells each variant with each seed; of the further ones the methods as they
    # are
    models = (
        "10m-sci",
        "10m-sci-seed1",
        "10m-sci-4way",
        "10m-sci-4way-seed1",
        "10m-m2dp",
        "20m-sci",
        "20m-m2dp",
    )
    assert list(lists["models"]) == [f"one-{model}" for model in models]
    assert (
        lists["models"]["one-10m-sci-4way-seed1"]["recipe"]
        == "method=sci method.n_way=4 method.epochs=100 method.seed=1"
    )
    assert list(lists["drives"]) == ["one-b", "one-d", "one-x"]
    assert (
        lists["views"]["one-sc"]["sequences"] == lists["labels"]["one-20m"]["sequences"] == "b d x"
    )
    own, seed, further = (
        lists["rankings"][f"one-{name}"] for name in ("10m-sci", "10m-sci-seed1", "20m-sci")
    )
    assert (own["tests"], own["perturbations"]) == ("d x", "turned construction")
    # only the method's own model gets queries with new walls
    assert (seed["tests"], seed["perturbations"]) == ("d x", "turned")
    assert (further["tests"], further["perturbations"]) == ("d", "")
    assert list(lists["perturbed"]) == [
        f"one-{view}-{name}" for view in ("sc", "cloud") for name in ("turned", "construction")
    ]
    assert lists["perturbed"]["one-sc-turned"] == {
        "view": "sc",
        "dataset": "one",
        "perturbation": "turned",
        "sequences": "d",
    }
    assert lists["events"]["one"]["sequences"] == "d"
    assert list(lists["absent"]) == ["one-slam", "one-viewpoints", "one-lifelong"]
    assert list(lists["latency"]) == ["one-10m"]


def test_without_latency_nothing_is_timed_and_nothing_waits_for_it() -> None:
    lists = expanded(one=ONE | {"latency": False})
    assert lists["latency"] == {}
    assert lists["absent"]["one-latency"] == {"out": "artifacts/latency/one"}
    assert lists["evaluations"] == expanded(one=ONE)["evaluations"]


def test_poses_are_found_within_the_budget_of_their_study() -> None:
    assert expanded(one=ONE | {"poses": ["sci"]})["poses"]["one-10m-sci"]["budget"] == "tiny"


def test_poses_are_a_variant_of_the_models_that_a_study_names() -> None:
    sci = SCI | {"seeds": 2, "variants": {"4way": "method.n_way=4"}}
    words = ONE | {"methods": [sci, M2DP], "poses": ["sci-4way", "m2dp"], "cells": ["20m"]}
    lists = expanded(one=words)
    posed = [
        f"{grid}-{name}"
        for grid in ("5m", "10m")
        for name in ("sci-4way", "sci-4way-seed1", "m2dp")
    ]
    assert list(lists["poses"]) == [f"one-{name}" for name in posed]
    assert lists["maps"] == {"one": {"dataset": "one", "train": "a"}}
    assert (
        lists["poses"]["one-5m-sci-4way-seed1"]["recipe"]
        == "method=sci method.n_way=4 method.seed=1"
    )
    own, with_poses = (
        lists["evaluations"][f"one-5m-sci-4way{pose}-seed1"] for pose in ("", "-pose")
    )
    assert (own["rankings"], own["model"]) == (
        "artifacts/localize/one/5m/sci-4way-seed1",
        "sci-4way-seed1",
    )
    assert (with_poses["rankings"], with_poses["model"]) == (
        "artifacts/poses/one/5m/sci-4way-seed1",
        "sci-4way-pose-seed1",
    )
    answerers = study("one", **words).answerers
    answers = [(model.method, model.variant_of_answers, model.seed) for model in answerers]
    assert answers[2:5] == [("sci", "4way", 0), ("sci", "4way-pose", 0), ("sci", "4way", 1)]
    assert answers[-2:] == [("m2dp", "", 0), ("m2dp", "pose", 0)]


def test_studies_do_not_mix() -> None:
    both = expanded(one=ONE, other=OTHER)
    alone = expanded(other=OTHER)
    del alone["report"]  # which is of all studies
    assert all(members.items() <= both[name].items() for name, members in alone.items())


def test_the_files_hold_what_they_were_made_of() -> None:
    tables = {"one": ONE, "other": OTHER, "turned": TURNED}
    studies = made(**tables)
    lists = yaml.safe_load(lists_text(studies))
    assert yaml.safe_load(studies_text(studies))["studies"] == tables
    check_lists(studies, lists["lists"])
    assert lists["first"] == {"study": "one", "grid": "5m"}


def test_a_study_of_many_drives_follows_from_lists_in_parts() -> None:
    studies = made(long=ONE | {"tests": [f"test{number}" for number in range(3 * MOST)]})
    lists = yaml.safe_load(lists_text(studies))["lists"]
    assert [len(lists[name]) for name in ("drives", "drives_2", "drives_3", "drives_4")] == [
        MOST,
        MOST,
        MOST,
        1,
    ]
    check_lists(studies, lists)
    lists["drives_4"] = {}
    with pytest.raises(ConfigError, match=r"conf/lists.yaml does not follow"):
        check_lists(studies, lists)


def test_lists_that_a_hand_left_behind_are_refused() -> None:
    lists = expanded(one=ONE)
    for edit in ({"tests": ["b", "c", "e"]}, {"methods": ["sci"]}, {"grids": ["20m"]}):
        with pytest.raises(ConfigError, match=r"conf/lists.yaml does not follow .* `yearloc use`"):
            check_lists(made(one=ONE | edit), lists)
    for broken in (None, [], {"drives": None}):
        with pytest.raises(ConfigError, match=r"conf/lists.yaml does not follow"):
            check_lists(made(one=ONE), broken)


def test_a_map_is_cut_into_squares_and_no_other_stage_reads_its_files() -> None:
    drives = {"source": "readers", "reads": "reader", "world": "recorded", "root": "r"}
    of_map = {"train": "map", "map": "/m.pcd", "poses": ["sci"]}
    lists = expanded(one=ONE | drives | of_map)
    assert lists["squares"] == {"one-map": {"dataset": "one", "sequence": "map", "files": "/m.pcd"}}
    assert [*lists["drives"]] == ["one-b", "one-c"]
    assert lists["submaps"]["one"]["sequences"] == "map b c"
    assert not lists["maps"]  # the stage `squares` writes it
    assert {pose["train"] for pose in lists["poses"].values()} == {"map"}
