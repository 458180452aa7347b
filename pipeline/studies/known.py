"""The studies that the stages behind `evaluate` look up by name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import ConfigError
from pipeline.running.texts import read_yaml
from pipeline.studies.expansion import QUESTIONS, Study, expand


def studies(conf: Path) -> Mapping[str, Any]:
    """The studies of studies.yaml in conf/; raises ConfigError where lists.yaml does not follow
    from them."""
    found, lists = (read_yaml(conf / f"{name}.yaml").get(name, {}) for name in ("studies", "lists"))
    return checked(found, lists)


def checked(studies: Mapping[str, Study], lists: Mapping[str, Any]) -> Mapping[str, Study]:
    """The studies, each with its question; raises ConfigError where conf/lists.yaml is not what
    they come to."""
    try:
        drives = {
            key: drive
            for name, part in lists.items()
            if name.startswith("drives")
            for key, drive in part.items()
        }
        follow = all(
            {**lists, "drives": drives}.get(name) == entries
            for name, entries in expand(studies).items()
        )
    except (AttributeError, KeyError, TypeError):  # a hand has left out what `yearloc use` fills in
        follow = False
    if not follow:
        raise ConfigError(
            "conf/lists.yaml does not follow from conf/studies.yaml; `yearloc use` generates it "
            "anew"
        )
    return {name: {"question": QUESTIONS[0], **study} for name, study in studies.items()}
