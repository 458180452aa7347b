"""Reads the studies by name, for the commands and for the stages behind `evaluate`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.running.texts import read_yaml
from pipeline.studies.expansion import expand
from pipeline.studies.study import RECORDED, SIMULATED, Study, named_file, settings_of

LEVEL = "flat"
"""How the files of conf/submap begin that gather level sweeps: all their points have one height."""


def studies(conf: Path) -> dict[str, Study]:
    """Read the studies of conf/studies.yaml.

    Raises ConfigError where lists.yaml does not follow from them.
    """
    return checked(read_studies(conf), read_yaml(conf / "lists.yaml").get("lists"))


def read_studies(conf: Path) -> dict[str, Study]:
    """The studies of conf/studies.yaml by name.

    Raises ConfigError where it holds none, and for one that `Study.of` or `refuse_unknown` refuse.
    """
    path = conf / "studies.yaml"
    tables = read_yaml(path).get("studies")
    if not (
        isinstance(tables, dict)
        and tables
        and all(isinstance(table, dict) for table in tables.values())
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
    """Raise ConfigError for a study that names a file which conf/ has not.

    Nor can it say that it is simulated where its data set is recorded, or want poses of altered
    level sweeps.
    """
    if study.poses and study.altered and study.submap.startswith(LEVEL):
        raise ConfigError(
            f"{study.name}: poses={','.join(study.poses)}: level sweeps (submap {study.submap}) "
            "are localised as driven alone; leave poses or altered out"
        )
    for method in study.methods:
        settings_of(conf, method.name)
    dataset = named_file(conf, study.name, "dataset", study.name)
    for group, name in (
        ("world", study.world),
        ("submap", study.submap),
        ("budget", study.budget),
        *(("alteration", alteration) for alteration in study.altered),
        *(("view", view) for method in study.methods for view in method.views),
        *(("path", path) for path in study.paths),
    ):
        named_file(conf, study.name, group, name)
    if study.simulated != read_yaml(dataset).get("simulated"):
        expected = RECORDED if study.simulated else SIMULATED
        raise ConfigError(
            f"conf/studies.yaml: {study.name}: source={study.origin['source']}: expected "
            f"{expected['source']}, by `simulated` in {dataset}"
        )


def checked(studies: Mapping[str, Study], lists: Any) -> dict[str, Study]:
    """The studies; raises ConfigError where the lists are not what they expand to."""
    lists = lists if isinstance(lists, Mapping) else {}
    drives = {
        key: drive
        for name, part in lists.items()
        if name.startswith("drives") and isinstance(part, Mapping)
        for key, drive in part.items()
    }
    if any(
        {**lists, "drives": drives}.get(name) != entries
        for name, entries in expand(studies).items()
    ):
        raise ConfigError(
            "conf/lists.yaml does not follow from conf/studies.yaml; `yearloc use` generates it "
            "anew"
        )
    return dict(studies)
