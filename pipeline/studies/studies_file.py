"""Reads conf/studies.yaml, the one list of what is learned and asked: checked studies by name.

A sweep of settings also needs conf/lists.yaml, which follows from it, to be up to date
(`read_listed_studies`).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.running.texts import read_yaml
from pipeline.studies.expansion import expand
from pipeline.studies.study import (
    RECORDED,
    SIMULATED,
    Study,
    faults_of,
    file_of,
    settings_of,
)

LEVEL = "flat"
"""The beginning of the names in conf/submap that gather level sweeps, of a 2-D laser."""


def read_listed_studies(conf: Path) -> dict[str, Study]:
    """Read the studies as `read_studies` does; raises ConfigError also if lists.yaml is stale."""
    studies = read_studies(conf)
    check_lists(studies, read_yaml(conf / "lists.yaml").get("lists"))
    return studies


def read_studies(conf: Path) -> dict[str, Study]:
    """Read the studies of conf/studies.yaml by name.

    Raises ConfigError if it holds none, or one that `Study.of` or `refuse_unknown` refuses.
    """
    path = conf / "studies.yaml"
    tables = read_yaml(path).get("studies")
    if (
        not isinstance(tables, dict)
        or not tables
        or not all(isinstance(table, dict) for table in tables.values())
    ):
        raise ConfigError(
            f"{path}: expected `studies:` with a study for each data set; `yearloc use campus` "
            "writes it anew"
        )
    studies_by_name = {name: Study.of(conf, name, table) for name, table in tables.items()}
    for study in studies_by_name.values():
        refuse_unknown(conf, study)
    return studies_by_name


def refuse_unknown(conf: Path, study: Study) -> None:
    """Raise ConfigError for a study that cannot be run, since

    - it names a file that conf/ does not have,
    - it says that it is simulated though its data set is recorded, or the other way round, or
    - it wants poses of altered level sweeps.
    """
    if study.poses and study.altered and study.submap.startswith(LEVEL):
        raise ConfigError(
            f"{study.name}: poses={','.join(study.poses)}: level sweeps (submap {study.submap}) "
            "are localised as driven alone; leave poses or altered out"
        )
    views = dict.fromkeys(view for method in study.methods for view in method.views)
    files = {
        "dataset": [study.name],
        "world": [study.world],
        "submap": [study.submap],
        "budget": [study.budget],
        "alteration": study.altered,
        "view": views,
        "path": study.paths,
    }
    with faults_of(study.name):
        for method in study.methods:
            settings_of(conf, method.name)
        for group, names in files.items():
            for name in names:
                file_of(conf, group, name)
        dataset = file_of(conf, "dataset", study.name)
        if study.simulated != read_yaml(dataset).get("simulated"):
            expected = RECORDED if study.simulated else SIMULATED
            raise ConfigError(
                f"source={study.origin['source']}: expected {expected['source']}, by `simulated` "
                f"in {dataset}"
            )


def check_lists(studies: Mapping[str, Study], lists: Any) -> None:
    """Raise ConfigError unless the lists of lists.yaml are what the studies expand to."""
    lists = lists if isinstance(lists, Mapping) else {}
    # a long list of drives lies in several parts (`parts`): join them
    drives: dict[str, Any] = {}
    for name, instances in lists.items():
        if name.startswith("drives") and isinstance(instances, Mapping):
            drives |= instances
    joined_lists = {**lists, "drives": drives}
    expected_lists = expand(studies)
    if any(joined_lists.get(name) != instances for name, instances in expected_lists.items()):
        raise ConfigError(
            "conf/lists.yaml does not follow from conf/studies.yaml; `yearloc use` generates it "
            "anew"
        )
