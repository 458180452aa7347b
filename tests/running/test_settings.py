"""Settings from a yaml: a wrong one is refused by name, with what was expected."""

from dataclasses import dataclass
from typing import Literal

import pytest

from pipeline.errors import ConfigError
from pipeline.methods.sci import Sci
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from pipeline.running.settings import check
from pipeline.views.scan_context import ScanContext


@dataclass(frozen=True)
class Plain:
    length_m: float = 1.0
    copies: int = 1
    name: str = "a"
    flag: bool = True
    way: Literal["up", "down", "off"] = "up"


@pytest.mark.parametrize("good", [{}, {"length_m": 2}, {"copies": -1}, {"flag": False}, {"way": "off"}])
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


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: Sci(epochs=-1), "method.epochs"),
        (lambda: Sci(batch=0), "method.batch"),
        (lambda: Sci(threads=0), "method.threads"),
        (lambda: Sci(learning_rate="abc"), "method.learning_rate"),
        (lambda: Sci(colormap="rainbow"), "method.colormap"),
        (lambda: Sci(dropout=1.5), "method.dropout"),
        (lambda: Sci(h_max_m=-1.0), "method.h_max_m"),
        (lambda: ScanContext(rings=0), "view.rings"),
        (lambda: ScanContext(beyond="keep"), "view.beyond"),
        (lambda: Compute(workers="many"), "compute.workers"),
        (lambda: Progress(budget=0), "budget.share"),
    ],
)
def test_what_a_person_may_mistype_is_refused_before_any_work(build, name):
    with pytest.raises(ConfigError, match=name):
        build()
