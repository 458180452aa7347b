"""Reads conf/studies.yaml: a file in; checked studies by name out.

The commands read it; a sweep wants conf/lists.yaml, which follows from it, to be up to date too.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.running.texts import read_yaml
from pipeline.studies.expansion import expand
from pipeline.studies.study import RECORDED, SIMULATED, Study, named_file, settings_of

LEVEL = "flat"
"""How the files of conf/submap begin that gather level sweeps: all their points have one height."""


def read_listed_studies(conf: Path) -> dict[str, Study]:
    """Read the studies of conf/studies.yaml as `read_studies` does.

    Raises ConfigError where lists.yaml does not follow from them.
    """
    studies = read_studies(conf)
    check_lists(studies, read_yaml(conf / "lists.yaml").get("lists"))
    return studies


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


def check_lists(studies: Mapping[str, Study], lists: Any) -> None:
    """Raise ConfigError where the lists of lists.yaml are not what the studies expand to.

    The drives of a large study are listed in several parts (`parts`).
    """
    lists = lists if isinstance(lists, Mapping) else {}
    drives = {
        instance: drive
        for name, part in lists.items()
        if name.startswith("drives") and isinstance(part, Mapping)
        for instance, drive in part.items()
    }
    listed = {**lists, "drives": drives}
    if any(listed.get(name) != instances for name, instances in expand(studies).items()):
        raise ConfigError(
            "conf/lists.yaml does not follow from conf/studies.yaml; `yearloc use` generates it "
            "anew"
        )
