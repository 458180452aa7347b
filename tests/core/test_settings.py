"""A wrong setting is refused with its name, and with what was expected instead."""

from dataclasses import dataclass
from typing import Literal

import pytest

from pipeline.alterations.construction import Construction
from pipeline.alterations.demolition import Demolition
from pipeline.alterations.turned import Turned
from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import check
from pipeline.mapping.octree import Octree
from pipeline.mapping.submaps import Accumulated, SingleScan
from pipeline.matching.sequences import SequenceMethod
from pipeline.methods.m2dp import M2dp
from pipeline.methods.pfl.afl import Afl
from pipeline.methods.pfl.pfl import Pfl
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from pipeline.methods.sad import Sad
from pipeline.methods.scan_context import ScanContext50
from pipeline.methods.scan_context_all import ScanContextAll
from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.views.birdview import BirdView
from pipeline.views.cloud import Cloud
from pipeline.views.m2dp import M2dp as M2dpView
from pipeline.views.scan_context import ScanContext


@dataclass(frozen=True)
class Plain:
    length_m: float = 1.0
    copies: int = 1
    name: str = "a"
    flag: bool = True
    way: Literal["up", "down", "off"] = "up"


@pytest.mark.parametrize(
    "good", [{}, {"length_m": 2}, {"copies": -1}, {"flag": False}, {"way": "off"}]
)
def test_a_value_of_the_declared_type_is_taken(good):
    check(Plain(**good), "plain")


@pytest.mark.parametrize(
    ("bad", "line"),
    [
        ({"length_m": "abc"}, "plain.length_m=abc: expected a number"),
        ({"length_m": float("nan")}, "plain.length_m=nan: expected a number"),
        ({"length_m": True}, "plain.length_m=True: expected a number"),
        ({"copies": 1.5}, "plain.copies=1.5: expected a whole number"),
        ({"name": 3}, "plain.name=3: expected a word"),
        ({"flag": 1}, "plain.flag=1: expected true or false"),
        ({"way": "left"}, "plain.way=left: expected up, down or off"),
    ],
)
def test_a_value_of_another_type_is_refused_by_name(bad, line):
    with pytest.raises(ConfigError) as error:
        check(Plain(**bad), "plain")
    assert str(error.value) == line


WRONG = [
    (
        Sci,
        "method",
        {
            "epochs": -1,
            "batch": 0,
            "threads": 0,
            "learning_rate": "abc",
            "colormap": "rainbow",
            "dropout": 1.5,
        },
    ),
    (Sci, "method", {"h_max_m": -1.0, "learning_rate": 0.0}),
    (
        SciRing,
        "method",
        {
            "yaw_noise_deg": -1.0,
            "worst_arc": 1.5,
            "widest_arc": 0,
            "refit": -0.1,
            "epochs": 0,
            "dropout": -0.5,
        },
    ),
    (ScanContext50, "method", {"candidates": 0, "least_engaged": 1.5}),
    (ScanContextAll, "method", {"least_engaged": -0.1}),
    (M2dp, "method", {"held_out_every_m": 0, "distinct_places": "yes"}),
    (PointNetVlad, "method", {"epochs": 0, "batch": 0, "train_points": 0, "schedule": "none"}),
    (PointNetVlad, "method", {"epochs": -1}),
    (
        Pfl,
        "method",
        {
            "width": 0,
            "epochs": -1,
            "batch": 1,
            "beta1": 1.0,
            "generator_steps": 0,
            "objective": "none",
            "kept": "first",
            "reference_headings": 3,
        },
    ),
    (Afl, "method", {"objective": "author_code"}),
    (Sad, "method", {"patch_px": 0, "length": "ten", "reference_headings": 0}),
    (
        SequenceMethod,
        "method",
        {"length": 0, "slowest": 0.0, "fastest": 0.7, "speed_step": 0.0, "contrast_rows": 1},
    ),
    (SequenceMethod, "method", {"novelty": "score", "both_ways": "no", "held_out_every_m": 0.0}),
    (
        Octree,
        "view.octree",
        {
            "depth": 1,
            "edge_m": 0.0,
            "motion": "walk",
            "rays": "some",
            "sigma_m": 0.0,
            "max_range_m": -1.0,
        },
    ),
    (Octree, "view.octree", {"depth": 6.5, "sensor_height_m": 13.0}),
    (ScanContext, "view", {"rings": 0, "sectors": -1, "max_range_m": 0.0, "beyond": "keep"}),
    (Cloud, "view", {"points": 0, "half_m": 0.0, "iterations": 0, "slope_deg": 91.0, "seed": "a"}),
    (M2dpView, "view", {"circles": 0, "sectors": 16.5, "azimuths": -1}),
    (BirdView, "view", {"headings": 12, "side_px": 0, "occupied": 0.4, "jitter_m": -1.0}),
    (BirdView, "view", {"headings": 0}),
    (SingleScan, "submap", {"step_m": -1.0}),
    (SingleScan, "submap", {"step_m": float("nan")}),
    (
        Accumulated,
        "submap",
        {"step_m": 0.0, "window_m": -1.0, "layout": "gps", "ground_percentile": 101.0},
    ),
    (Accumulated, "submap", {"ground_radius_m": float("nan")}),
    (Turned, "alteration", {"repeats": 0, "seed": -1}),
    (Turned, "alteration", {"repeats": 1.5}),
    (Demolition, "alteration", {"widths_deg": [0], "seed": -1}),
    (Demolition, "alteration", {"widths_deg": []}),
    (Demolition, "alteration", {"widths_deg": [360]}),
    (
        Construction,
        "alteration",
        {"walls": [0], "shadows": [], "seed": -1, "spacing_m": 0, "skew_deg": 90, "nearest_m": 21},
    ),
    (
        Construction,
        "alteration",
        {"walls": [], "shortest_m": 30, "lowest_m": 11, "sensor_height_m": 3.0},
    ),
    (Compute, "compute", {"workers": "many"}),
]


@pytest.mark.parametrize(
    ("kind", "group", "field", "value"),
    [(kind, group, field, value) for kind, group, wrong in WRONG for field, value in wrong.items()],
)
def test_what_a_person_may_mistype_is_refused_before_any_work(kind, group, field, value):
    with pytest.raises(ConfigError, match=f"{group}.{field}="):
        kind(**{field: value})


def test_probabilities_distances_and_budgets_out_of_order_are_refused():
    for wrong in ({"hit": 0.4}, {"miss": 0.5}, {"lowest": 0.45}, {"highest": 1.0}):
        with pytest.raises(ConfigError, match=r"view\.octree: .*must increase"):
            Octree(**wrong)
    with pytest.raises(ConfigError, match=r"view\.low_m="):
        BirdView(high_m=0.3)
    with pytest.raises(ConfigError, match=r"method\.negative_m="):
        PointNetVlad(positive_m=50.0)
    with pytest.raises(ConfigError, match=r"budget\.share"):
        Progress(budget=0)
