"""Several perturbations joined into one, and the yamls of conf/perturbation."""

import json
from dataclasses import asdict, fields
from pathlib import Path
from pydoc import locate

import numpy as np
import pytest
import yaml
from hydra.utils import instantiate
from omegaconf import OmegaConf

from pipeline.core.errors import ConfigError
from pipeline.perturbations import UNCHANGED, Case, Perturbation, read_cases
from pipeline.perturbations.construction import Construction
from pipeline.perturbations.demolition import Demolition
from pipeline.perturbations.several import Several
from pipeline.perturbations.turned import Turned
from tests.perturbations.made import perturbed

CONF = sorted((Path(__file__).parents[2] / "conf/perturbation").glob("*.yaml"))
POINTS_M = np.random.default_rng(2).uniform((-40, -40, 0), (40, 40, 15), (500, 3))
GLANCE = Several([Turned(repeats=1), Demolition([60]), Construction([2], shadows=[False])])


def test_parts_follow_one_unperturbed_case() -> None:
    assert GLANCE.cases == (
        Case(),
        Case("turned"),
        Case("demolition", 60.0),
        Case("construction", 2.0),
    )


@pytest.mark.parametrize(
    ("few", "whole"),
    [
        (GLANCE, Turned),
        (GLANCE, Demolition),
        (GLANCE, Construction),
        (Construction([2], shadows=[True]), Construction),
    ],
)
def test_a_case_is_the_same_beside_any_others_and_another_with_another_seed_or_query(
    few: Perturbation, whole: type[Perturbation]
) -> None:
    def changed(perturbation: Perturbation, stamp_ns: int = 3) -> tuple[bytes, float]:
        points, left_rad = perturbed(perturbation, POINTS_M, stamp_ns)[
            perturbation.cases.index(case)
        ]
        return points.tobytes(), left_rad

    (case,) = set(few.cases[1:]) & set(whole().cases)
    assert changed(few) == changed(whole())
    assert changed(whole(seed=1)) != changed(whole()) != changed(whole(), stamp_ns=4)


def test_parts_that_cannot_be_distinguished_are_refused() -> None:
    with pytest.raises(ConfigError, match="one seed"):
        Several([Turned(), Demolition(seed=1)])
    with pytest.raises(ConfigError, match="in common"):
        Several([Demolition(), Demolition([60])])
    with pytest.raises(ConfigError, match="one seed"):
        Several([])
    with pytest.raises(ConfigError, match=r"each with its _target_, got \[3\]"):
        Several([Demolition(), 3])  # type: ignore[list-item]


@pytest.mark.parametrize(
    "perturbation",
    [GLANCE, Turned(), Demolition(), Construction()],
    ids=lambda one: type(one).__name__,
)
def test_the_first_case_leaves_the_points_unperturbed(perturbation: Perturbation) -> None:
    assert perturbation.cases[0] == Case() == Case(UNCHANGED, 0.0, False, 0)
    points_m, left_rad = perturbation.perturb(Case(), POINTS_M, np.random.default_rng(0))
    assert points_m is POINTS_M
    assert left_rad == 0.0


def test_cases_come_back_from_the_attributes_of_an_artifact() -> None:
    attrs = json.loads(json.dumps({"cases": [asdict(case) for case in GLANCE.cases]}))
    assert read_cases(attrs["cases"]) == [*GLANCE.cases]


@pytest.mark.parametrize("path", CONF, ids=lambda path: path.stem)
def test_a_perturbation_is_one_yaml_with_its_fields(path: Path) -> None:
    conf = yaml.safe_load(path.read_text())
    made = instantiate(OmegaConf.load(path))
    assert made.cases[0] == Case()
    assert made.seed == 0
    if path.stem == "glance":
        assert made == GLANCE
    else:
        assert conf.pop("_target_") == f"pipeline.perturbations.{path.stem}.{type(made).__name__}"
        assert conf.keys() == {field.name for field in fields(made)}
        assert made == locate(f"pipeline.perturbations.{path.stem}.{type(made).__name__}")()
