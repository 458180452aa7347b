"""Each step of a proposal changes a study in one way, and refuses what it cannot mean."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.core.errors import ConfigError, YearlocError
from pipeline.studies.proposal import (
    Request,
    propose,
    refuse_unposed,
    with_experiment,
    with_models,
    with_perturbations,
    with_poses,
    with_scale,
    with_stress,
    with_timing,
)
from pipeline.studies.study import Study
from tests.mapping import made_map
from tests.readers.damage import one_line
from tests.studies.made import CONF, RECORDED, study

DEFAULTS: dict[str, Any] = {
    "stress": {"demo": {"s": "all reversed"}, "tiny": {}},
    "variants": {"sci": {"4way": "method.n_way=4"}, "sad": {"far": "method.far=1"}},
    "perturbed": {"turned": 2},
    "poses": {"demo": ["sci"]},
}
PLAIN = study(tests=["a", "b", "c"], methods=["sci", "m2dp"])


def asked(**options: str) -> Request:
    """What a person asks by these options, on top of DEFAULTS."""
    return Request(CONF, options, DEFAULTS)


def test_a_data_sets_variants_of_a_experiment_stand_beside_those_of_the_experiment() -> None:
    options = {
        "experiment": "viewpoints",
        "methods": "pfl,afl,sad",
        "variants": "30m,paper,logistic",
    }
    suburb, _ = propose(CONF, "suburb", options)
    pfl, afl, sad = suburb.methods
    assert pfl.variants.keys() == {"30m", "paper", "logistic"}
    assert (afl.variants.keys(), sad.variants.keys()) == ({"logistic"}, {"30m"})
    assert (sad.view_of(""), sad.view_of("30m")) == ("birdview", "birdview_near")
    assert pfl.views == ("birdview", "birdview_near")


def test_a_preset_has_its_own_stress_and_a_recorded_study_none() -> None:
    assert with_stress(PLAIN, asked()).stress == {"s": "all reversed"}
    assert with_stress(PLAIN, asked(world="tiny")) == PLAIN
    recorded = replace(study(**RECORDED), stress={})
    assert with_stress(recorded, asked()) == recorded


def test_a_scale_replaces_submaps_cells_tolerance_views_and_settings() -> None:
    assert with_scale(PLAIN, asked()) is PLAIN
    indoor = with_scale(PLAIN, asked(scale="indoor"))
    assert (indoor.submap, indoor.grid_names, indoor.tolerance.correct_m) == (
        "single_20cm",
        ["2m"],
        2.0,
    )
    sci, m2dp = indoor.methods
    assert (sci.view, m2dp.view) == ("scan_context_20m", "m2dp")
    assert "h_max_m" in sci.settings
    assert "h_max_m" not in m2dp.settings  # its yaml has no such setting
    assert (indoor.train, indoor.tests, indoor.budget) == (PLAIN.train, PLAIN.tests, PLAIN.budget)


def test_only_what_draws_at_random_has_seeds_and_only_listed_methods_have_variants() -> None:
    sci, m2dp = with_models(PLAIN, asked(seeds="3")).methods
    assert (sci.seeds, m2dp.seeds) == (3, 1)
    assert (sci.variants, m2dp.variants) == ({"4way": "method.n_way=4"}, {})
    assert not with_models(PLAIN, asked(variants="")).methods[0].variants
    with pytest.raises(ConfigError, match="variants=far: expected some of 4way"):
        with_models(PLAIN, asked(variants="far"))


def test_perturbed_sequences_are_spread_from_the_first_to_the_last() -> None:
    assert with_perturbations(PLAIN, asked()).perturbed == {"turned": ("a", "c")}
    assert with_perturbations(PLAIN, asked(perturbed="")).perturbed == {}
    cells = with_perturbations(PLAIN, asked(cells="5m,20m")).cells
    assert [cell.cell_m for cell in cells] == [5.0, 20.0]


def test_poses_are_those_of_the_preset_or_those_asked_for() -> None:
    assert with_poses(PLAIN, asked()).poses == ("sci",)
    assert with_poses(PLAIN, asked(world="tiny")).poses == ()
    assert with_poses(PLAIN, asked(poses="m2dp", paths="filter")).paths == ("filter",)
    with pytest.raises(ConfigError, match="paths=filter: joins poses along a drive"):
        with_poses(PLAIN, asked(world="tiny", paths="filter"))


def test_slam_among_poses_is_no_model() -> None:
    """Alone, it leaves the choice of models that have poses to the data set's yaml."""
    alone = with_poses(PLAIN, asked(poses="slam"))
    assert (alone.poses, alone.slam) == (("sci",), True)
    both = with_poses(PLAIN, asked(poses="slam,m2dp"))
    assert (both.poses, both.slam) == (("m2dp",), True)
    assert not with_poses(PLAIN, asked(poses="m2dp")).slam
    assert not with_poses(PLAIN, asked(poses="")).slam


def test_logs_without_poses_need_slam_and_parts_by_time() -> None:
    without = {"ground_truth": None}
    with pytest.raises(
        ConfigError, match=r"reader.ground_truth of its yaml names no poses; say poses="
    ):
        refuse_unposed(PLAIN, without)
    refuse_unposed(PLAIN, {"ground_truth": "/odom"})
    refuse_unposed(replace(PLAIN, slam=True), without)
    refuse_unposed(replace(PLAIN, slam=True, tests=("a+time2of2",)), without)
    with pytest.raises(ConfigError, match=r"a\+path2of2: a split by path"):
        refuse_unposed(replace(PLAIN, slam=True, tests=("a+path2of2",)), without)


def test_viewpoints_need_methods_on_bird_views_and_latency_is_yes_or_no() -> None:
    with pytest.raises(ConfigError, match="methods=sci,m2dp: only methods that look at bird-views"):
        with_experiment(replace(PLAIN, experiment="viewpoints"), asked())
    assert not with_timing(PLAIN, asked(latency="no")).latency
    assert with_timing(PLAIN, asked(latency="yes")) == PLAIN


def test_a_proposal_is_read_as_it_is_written() -> None:
    proposed, _ = propose(CONF, "campus", {"experiment": "lifelong", "scale": "indoor"})
    assert study("campus", **proposed.table()) == proposed


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    """A root with the map `town.pcd` and the sequence `car`."""
    return made_map.drive(tmp_path)


def on_map(root: Path, **options: str) -> Study:
    """The study of data set nova that learns the map."""
    given = {"map": str(root / "town.pcd"), "root": str(root), **options}
    return propose(CONF, "nova", given)[0]


def test_a_map_is_learned_instead_of_a_drive(drives: Path) -> None:
    study = on_map(drives)
    assert (study.train, study.tests, study.drives) == (("map",), ("car",), ("car",))
    assert study.map == str(drives / "town.pcd")
    (method,) = study.methods
    assert (method.name, method.settings) == ("bev_correlation", {"of_map": True})
    assert study.poses == ("bev_correlation",)
    assert study.training == "a 3-D map"
    assert Study.of(CONF, "nova", study.table()) == study


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"methods": "sci"}, "methods=sci: learns scans, and a map has none"),
        ({"train": "car"}, "nova with map= has no option train"),
        ({"experiment": "robustness"}, "nova with map= has no option experiment"),
        ({"poses": "slam"}, "poses=slam: poses in a map are not estimated"),
        ({"tests": "map"}, "tests=map: is the training sequence"),
        ({"map": "nowhere.pcd"}, "nowhere.pcd: no such map"),
    ],
)
def test_what_a_map_cannot_do_is_refused(
    drives: Path, options: dict[str, str], complaint: str
) -> None:
    with one_line(YearlocError, complaint):
        on_map(drives, **options)


def test_a_sequence_of_the_name_map_is_refused_beside_a_map(drives: Path) -> None:
    (drives / "car").rename(drives / "map")
    with one_line(ConfigError, "a sequence of this name, which is kept for the map: rename it"):
        on_map(drives)
