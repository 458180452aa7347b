"""Reads the studies by name, for the stages behind `evaluate`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import ConfigError
from pipeline.running.texts import read_yaml
from pipeline.studies.expansion import QUESTIONS, Study, expand


def studies(conf: Path) -> Mapping[str, Any]:
    """Read the studies of conf/studies.yaml.

    Raises ConfigError where lists.yaml does not follow from them.
    """
    studies_written, lists = (
        read_yaml(conf / f"{name}.yaml").get(name, {}) for name in ("studies", "lists")
    )
    return checked(studies_written, lists)


def checked(studies: Mapping[str, Study], lists: Mapping[str, Any]) -> Mapping[str, Study]:
    """The studies, each with its question.

    Raises ConfigError where the lists are not what the studies expand to.
    """
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
