"""Composes the settings of each stage in a job: the job's overrides in, configurations out.

An override of a sweep, such as method.n_way=4, applies only to some stages of the chain. This
module expands the chain for the job's study (`lists_of_job`), and composes each stage's yaml with
the overrides of fields that this stage has (`Composer`).
"""

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
"""The groups of conf/: folders of files, of which a stage's configuration takes one."""
LISTED = ("world", "submap", "budget", "grid", "method", "view", "tolerance")
"""The groups whose file the lists of the chain name for each step."""
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
"""The stages that a job may run. Their settings can be swept, those of later stages cannot."""


def own_fields() -> dict[str, dict[str, Any]]:
    """The settings of each stage's own file, by stage, except those that dvc.yaml fills in."""
    fields_by_stage = {}
    for stage in CHAIN:
        path = ROOT / "conf" / f"{stage}.yaml"
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        fields = {
            key: value
            for key, value in content.items()
            if key not in ("defaults", "hydra") and value is not None
        }
        if fields:
            fields_by_stage[stage] = fields
    return fields_by_stage


def lists_of_job(study: Study, overrides: Mapping[str, str], method_view: str) -> dict[str, Any]:
    """The lists of the chain for a job: its study with one grid and one method.

    The job's `overrides` choose the files of groups such as grid or method; the defaults are the
    study's first. `method_view` is the view of the job's method in its yaml. Raises ConfigError for
    a study that does not test over the year.
    """
    if not study.tests_over_days:
        raise ConfigError(
            f"dataset={study.name}: this study tests turned robots only, and a sweep compares over "
            "the year; see `yearloc use`"
        )
    conf = ROOT / "conf"
    name = overrides.get("method", study.methods[0].name)
    method = _method_of_job(study, name, overrides, method_view)
    grid = overrides.get("grid", study.grids[0].name)
    job_study = replace(
        study,
        world=overrides.get("world", study.world),
        submap=overrides.get("submap", study.submap),
        budget=overrides.get("budget", study.budget),
        grids=(CellSize.read(conf, grid),),
        methods=(method,),
        cells=(),
        stress={},
        poses=(),
    )
    return expand({study.name: job_study})


def _method_of_job(
    study: Study, name: str, overrides: Mapping[str, str], method_view: str
) -> StudyMethod:
    """The job's method, with the settings that the study changes in any of its methods."""
    view_in_study = {method.name: method.view for method in study.methods}
    if overrides.get("view"):
        view = overrides["view"]
    elif "method.view" in overrides:
        view = method_view
    else:
        view = view_in_study.get(name, method_view)
    changed_settings: dict[str, Any] = {}
    for study_method in study.methods:
        changed_settings |= study_method.settings
    own_settings = settings_of(ROOT / "conf", name)
    return replace(
        StudyMethod.described(ROOT / "conf", name, view),
        settings={key: value for key, value in changed_settings.items() if key in own_settings},
    )


class Composer:
    """Composes the settings of each step (an instance of a stage) from a job's overrides."""

    def __init__(self, overrides: Mapping[str, str]) -> None:
        self._overrides = overrides

    def settings(self, step: Step) -> StepSettings:
        """All settings that the step's result depends on, without its inputs and code."""
        choices, changes = self._words(step)
        files = tuple((PurePath(file).parts, keys) for file, keys in step.params.items())
        values = _values(step.stage, choices + changes, files)
        values_of_conf = _values(step.stage, choices, files) if changes else values
        return StepSettings(values, follows_conf=values == values_of_conf)

    def config(self, step: Step, fields: Mapping[str, str]) -> DictConfig:
        """The step's whole configuration, with `fields` for its paths and names."""
        choices, changes = self._words(step)
        return _composed(
            step.stage,
            (*choices, *changes, *(f"{field}='{value}'" for field, value in fields.items())),
        )

    def _words(self, step: Step) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The step's choices of files, and the job's overrides that change its settings."""
        choices = tuple(f"{group}={choice}" for group, choice in step.choices.items())
        groups_of_stage = _composed(step.stage, ()).keys() & GROUPS
        changes = []
        for key, value in self._overrides.items():
            head, dot, field = key.partition(".")
            if dot and head == step.stage:  # train.k=1: a field of the stage itself
                changes.append(f"{field}={value}")
            elif head in groups_of_stage and (dot or head not in LISTED):
                changes.append(f"{key}={value}")
        return choices, tuple(changes)


@cache
def _composed(stage: str, overrides: tuple[str, ...]) -> DictConfig:
    """Compose a stage's configuration, as its own command would."""
    cfg = compose(stage, list(overrides))  # with the Hydra that runs the job
    return within_budget(cfg, overrides) if stage == "train" else cfg


@cache
def _values(
    stage: str,
    overrides: tuple[str, ...],
    files: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...],
) -> dict[str, Any]:
    """The stage's own fields, and each group's keys in `files`; without keys the whole group."""
    settings: Any = OmegaConf.to_container(_composed(stage, overrides))
    values = {key: value for key, value in settings.items() if key not in GROUPS}
    for parts, keys in files:
        if len(parts) == 3:  # a file of a group, not a stage's own
            _, group, _ = parts
            content = settings[group]
            values[group] = {key: content.get(key) for key in keys} if keys else content
    return values
