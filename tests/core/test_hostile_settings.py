"""Every class that conf/ builds takes any value of any setting, or refuses it in one clear line."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest
from hydra.errors import InstantiationException
from hydra.utils import get_class, instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.core.errors import ConfigError, YearlocError
from pipeline.core.settings import Count, NotNegative, Positive, Seed, Share, within

ROOT = Path(__file__).parents[2]
HOSTILE = (-1, 0, 10**9, float("nan"), float("inf"), True, "ten", None, [1])
UNLISTED = ("lists.yaml", "studies.yaml")


def collect(node: object, descriptions: dict[str, DictConfig]) -> None:
    """Collect the first description of each class that a conf file builds, by its name."""
    if isinstance(node, DictConfig):
        if "_target_" in node:
            descriptions.setdefault(node["_target_"], node)
        for key in node:
            child = OmegaConf.select(node, str(key), throw_on_resolution_failure=False)
            collect(child, descriptions)


def classes() -> Iterator[tuple[str, DictConfig]]:
    """The names and descriptions of all dataclasses that the files of conf/ build."""
    descriptions: dict[str, DictConfig] = {}
    for path in sorted((ROOT / "conf").rglob("*.yaml")):
        if path.name not in UNLISTED:
            collect(OmegaConf.load(path), descriptions)
    for target, node in descriptions.items():
        if is_dataclass(get_class(target)) and not target.endswith(".Recorded"):
            yield target, node


@pytest.mark.parametrize(
    ("target", "node"),
    [pytest.param(target, node, id=target.rpartition(".")[2]) for target, node in classes()],
)
def test_a_hostile_value_is_taken_or_refused_in_one_line(target: str, node: DictConfig) -> None:
    instantiate(node)
    refused = []
    for field in fields(get_class(target)):
        for value in HOSTILE:
            try:
                instantiate(node, **{field.name: value})
            except InstantiationException as error:
                refused.append((field.name, value, error.__cause__))
            except OmegaConfBaseException:  # a list where a table is described
                refused.append((field.name, value, YearlocError("")))
    assert refused or not fields(get_class(target))
    assert not [
        (name, value, error)
        for name, value, error in refused
        if not isinstance(error, YearlocError) or "\n" in str(error)
    ]


@pytest.mark.parametrize(
    ("hint", "value", "said"),
    [
        (Positive, 0, "a number above 0"),
        (Positive, 2e6, "at most 1,000,000"),
        (NotNegative, -0.5, "a number of at least 0"),
        (Share, 1.5, "a share from 0 to 1"),
        (Count, 2.5, "a whole number"),
        (Seed, 2**32, "at most 4,294,967,295"),
    ],
)
def test_a_number_out_of_its_range_is_refused_with_what_was_expected(
    hint: object, value: float, said: str
) -> None:
    with pytest.raises(ConfigError, match=f"^k={value}: expected {said}$"):
        within("k", value, hint)


def test_a_range_may_reach_beyond_the_largest_number_without_one() -> None:
    """Numbers without a range end at a million, seeds at 2³² − 1."""
    within("seed", 2**32 - 1, Seed)
    with pytest.raises(ConfigError, match=r"^k=2000000: expected at most 1,000,000$"):
        within("k", 2_000_000, int)
