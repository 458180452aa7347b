"""A wrong setting is refused with its name, and with what was expected instead."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import pytest
import yaml

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import Names, check, filled, plain, written
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
from pipeline.perturbations.construction import Construction
from pipeline.perturbations.demolition import Demolition
from pipeline.perturbations.turned import Turned
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
    (Sci, "method.epochs", -1),
    (Sci, "method.learning_rate", 0.0),
    (Sci, "method.colormap", "rainbow"),
    (SciRing, "method.widest_arc", 0),
    (ScanContext50, "method.candidates", 0),
    (ScanContextAll, "method.least_engaged", -0.1),
    (M2dp, "method.distinct_places", "yes"),
    (PointNetVlad, "method.schedule", "none"),
    (Pfl, "method.batch", 1),
    (Pfl, "method.beta1", 1.0),
    (Afl, "method.objective", "author_code"),
    (Sad, "method.length", "ten"),
    (SequenceMethod, "method.fastest", 0.7),
    (SequenceMethod, "method.both_ways", "no"),
    (Octree, "view.octree.depth", 6.5),
    (Octree, "view.octree.motion", "walk"),
    (ScanContext, "view.beyond", "keep"),
    (Cloud, "view.slope_deg", 91.0),
    (M2dpView, "view.sectors", 16.5),
    (BirdView, "view.headings", 12),
    (SingleScan, "submap.step_m", float("nan")),
    (Accumulated, "submap.ground_percentile", 101.0),
    (Turned, "perturbation.repeats", 1.5),
    (Demolition, "perturbation.widths_deg", [360]),
    (Construction, "perturbation.walls", []),
    (Construction, "perturbation.lowest_m", 11),
    (Compute, "compute.workers", "many"),
]


@pytest.mark.parametrize(("kind", "name", "value"), WRONG)
def test_what_a_person_may_mistype_is_refused_before_any_work(kind, name, value):
    with pytest.raises(ConfigError, match=f"^{name}="):
        kind(**{name.rpartition(".")[2]: value})


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


@dataclass(frozen=True)
class Part:
    name: str
    size_m: float | None
    note: str | None = None


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    sequences: Names = ()
    box: tuple[float, float] = (0.0, 1.0)
    days: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    from_: Path | None = None


TABLE = {"parts": [{"name": "a", "size_m": None}], "from": "x", "sequences": "01 02"}


def test_a_table_is_filled_and_written_again() -> None:
    whole = filled(Whole, TABLE | {"days": {"2012-01-15": ["a"]}})
    expected = Whole((Part("a", None),), ("01", "02"), days={"2012-01-15": ("a",)})
    assert whole == replace(expected, from_=Path("x"))
    # a word of a command line: a mapping as pairs, so that YAML reads no date
    assert written(expected) == (
        '{parts: [{name: "a", size_m: null}], sequences: ["01", "02"], '
        'days: [["2012-01-15", ["a"]]]}'
    )
    assert filled(Whole, yaml.safe_load(written(expected))) == expected
    # a file: without what is null by default, and if not whole without all defaults
    table = {"parts": [{"name": "a", "size_m": None}], "sequences": ["01", "02"]}
    assert plain(replace(expected, days={})) == table
    assert plain(replace(expected, days={}), whole=True) == table | {"box": [0.0, 1.0], "days": {}}


def test_a_name_may_stand_for_an_object() -> None:
    named = filled(
        Whole,
        {"parts": ["a", {"name": "b", "size_m": 1}]},
        lambda kind, value: kind(value, 2.0) if isinstance(value, str) else value,
    )
    assert named.parts == (Part("a", 2.0), Part("b", 1))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"parts": [{"name": "a"}]}, "not given: parts[0].size_m"),
        ({"parts": None}, "not given: parts; say it"),
        ({"parts": ["a"]}, "parts[0]=a: expected a table of the settings of Part"),
        ({"parts": [{"name": "a", "size_m": "1"}]}, "parts[0].size_m=1: expected a number or null"),
        ({"parts": 1}, "parts=1: expected a list"),
        ({"box": [1]}, "box=[1]: expected a list of 2"),
        ({"days": [1]}, "days=[1]: expected a table"),
        ({"days": {"monday": "a"}}, "days.monday=a: expected a list"),
    ],
)
def test_a_wrong_setting_in_a_table_is_named_by_its_path(change, line):
    with pytest.raises(ConfigError) as error:
        filled(Whole, TABLE | change, advice="; say it")
    assert str(error.value) == line
