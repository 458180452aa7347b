"""Composes each stage's settings from a sweep's overrides."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import PurePath
from typing import Any

import yaml
from hydra import compose
from omegaconf import DictConfig, OmegaConf

from pipeline.core.errors import ConfigError
from pipeline.studies.expansion import expand
from pipeline.studies.study import CellSize, Study, StudyMethod, settings_of
from pipeline.sweeps.chain import Step
from pipeline.sweeps.resolver import StepSettings
from stages import ROOT, within_budget

GROUPS = {path.name for path in (ROOT / "conf").iterdir() if path.is_dir() and path.name != "hydra"}
LISTED = (
    "world",
    "submap",
    "budget",
    "grid",
    "method",
    "view",
    "tolerance",
)  # groups whose file conf/lists.yaml names
CHAIN = (
    "logs",
    "scans",
    "submaps",
    "views",
    "birdviews",
    "labels",
    "train",
    "localize",
    "evaluate",
)
"""The stages that a job may run; their own settings can be swept, those of the stages behind them
cannot."""


def own_fields() -> dict[str, dict[str, Any]]:
    """The settings of each stage's own file, by stage; not those that dvc.yaml fills in."""
    files = {
        stage: yaml.safe_load((ROOT / "conf" / f"{stage}.yaml").read_text(encoding="utf-8"))
        for stage in CHAIN
    }
    inherited = ("defaults", "hydra")
    own_settings = {
        name: {k: v for k, v in file.items() if k not in inherited and v is not None}
        for name, file in files.items()
    }
    return {name: fields for name, fields in own_settings.items() if fields}


def listed(study: Study, overrides: Mapping[str, str], method_view: str) -> dict[str, Any]:
    """The lists for a job of one study, grid and method, unless `overrides` name others.

    `method_view` is the view of the job's method in its yaml.
    """
    if not study.asks_about_the_year:
        raise ConfigError(
            f"dataset={study.name}: judges turned robots alone; a sweep compares over the year, "
            "see `yearloc use`"
        )
    conf = ROOT / "conf"
    views = {method.name: method.view for method in study.methods}
    name = overrides.get("method", study.methods[0].name)
    view = overrides.get("view") or (
        method_view if "method.view" in overrides else views.get(name, method_view)
    )
    changed_settings = {
        key: value for method in study.methods for key, value in method.settings.items()
    }
    own_settings = settings_of(conf, name)
    method = replace(
        StudyMethod.described(conf, name, view),
        settings={key: value for key, value in changed_settings.items() if key in own_settings},
    )
    grid = overrides.get("grid", study.grids[0].name)
    job_study = replace(
        study,
        world=overrides.get("world", study.world),
        submap=overrides.get("submap", study.submap),
        budget=overrides.get("budget", study.budget),
        grids=(CellSize.read(conf, study.name, grid),),
        methods=(method,),
        cells=(),
        stress={},
        poses=(),
    )
    return expand({study.name: job_study})


class Composer:
    """Composes each step's settings from a job's overrides."""

    def __init__(self, overrides: Mapping[str, str]) -> None:
        self._overrides = overrides

    def settings(self, step: Step) -> StepSettings:
        """All settings that the step's result depends on; inputs and code are not among them."""
        choices, changes = self._words(step)
        files = tuple((PurePath(file).parts, keys) for file, keys in step.params.items())
        values = _values(step.stage, choices + changes, files)
        follows_conf = not changes or values == _values(step.stage, choices, files)
        return StepSettings(values, follows_conf)

    def config(self, step: Step, fields: Mapping[str, str]) -> DictConfig:
        """The step's whole configuration, with `fields` for its paths and names."""
        choices, changes = self._words(step)
        return _composed(
            step.stage,
            (*choices, *changes, *(f"{field}='{value}'" for field, value in fields.items())),
        )

    def _words(self, step: Step) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The step's choices of files, and the overrides of something in its configuration."""
        groups = _composed(step.stage, ()).keys() & GROUPS
        changes = []
        for key, value in self._overrides.items():
            head, dot, field = key.partition(".")
            if dot and head == step.stage:
                changes.append(f"{field}={value}")
            elif head in groups and (dot or head not in LISTED):
                changes.append(f"{key}={value}")
        return tuple(f"{group}={choice}" for group, choice in step.choices.items()), tuple(changes)


@cache
def _composed(stage: str, overrides: tuple[str, ...]) -> DictConfig:
    cfg = compose(stage, list(overrides))  # by the Hydra that runs the job
    return within_budget(cfg, overrides) if stage == "train" else cfg


@cache
def _values(stage: str, overrides: tuple[str, ...], files: Any) -> dict[str, Any]:
    """The stage's own fields and what it takes of each tracked group."""
    settings: Any = OmegaConf.to_container(_composed(stage, overrides))
    values = {key: value for key, value in settings.items() if key not in GROUPS}
    for parts, keys in files:
        if len(parts) == 3:
            group = settings[parts[1]]
            values[parts[1]] = {key: group.get(key) for key in keys} if keys else group
    return values
