"""Writes and reads the study that was measured, as a file beside its table of results.

conf/studies.yaml may change after a study was measured. Whatever shows results therefore reads the
study from here, and can say that its results are out of date (`stale`).
"""

from collections.abc import Mapping
from pathlib import Path

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.settings import filled, written
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study

FILE = "study.yaml"
"""The name of the file, in the folder of the study's results."""


def write(folder: Path, study: Study) -> None:
    """Write a study into the folder of its results."""
    (folder / FILE).write_text(f"{written(study)}\n", encoding="utf-8")


def read(layout: Layout, name: str) -> Study:
    """Read the measured study of this name; raises ArtifactError if there are no results of it."""
    path = layout.path("results", name, FILE)
    if not path.is_file():
        raise ArtifactError(f"{path}: no results yet; `dvc repro` gathers them")
    return filled(Study, read_yaml(path))


def stale(layout: Layout, studies: Mapping[str, Study]) -> list[str]:
    """The names of the studies that were changed since they were measured, or never were."""
    return [name for name, study in studies.items() if _measured(layout, name) != study]


def _measured(layout: Layout, name: str) -> Study | None:
    """The measured study, or None if there is none that can be read."""
    try:
        return read(layout, name)
    except (ArtifactError, ConfigError):
        return None
