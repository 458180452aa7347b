"""The study that a table of results is of, which the stage `results` keeps beside it.

What reads results asks for the study that was measured, whatever conf/studies.yaml says by now.
"""

from collections.abc import Mapping
from pathlib import Path

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.settings import filled, written
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study

FILE = "study.yaml"


def write(folder: Path, study: Study) -> None:
    """Write a study into the folder of its results."""
    (folder / FILE).write_text(f"{written(study)}\n", encoding="utf-8")


def read(layout: Layout, name: str) -> Study:
    """Read the study of the results of this name; raises ArtifactError where there are none."""
    path = layout.path("results", name, FILE)
    if not path.is_file():
        raise ArtifactError(f"{path}: no results yet; `dvc repro` gathers them")
    return filled(Study, read_yaml(path), lambda table: table)


def stale(layout: Layout, studies: Mapping[str, Study]) -> list[str]:
    """The names of the studies whose results are of another study: one that was changed since."""
    return [name for name, study in studies.items() if _measured(layout, name) != study]


def _measured(layout: Layout, name: str) -> Study | None:
    try:
        return read(layout, name)
    except (ArtifactError, ConfigError):
        return None
