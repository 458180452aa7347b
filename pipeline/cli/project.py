"""The project that the commands are called in: its conf folder and its studies."""

from pathlib import Path
from typing import Any

from pipeline.errors import ConfigError
from pipeline.running.texts import read_yaml


def conf_folder() -> Path:
    """The project's conf folder; the command is meant to be called from the project's root.

    Raises ConfigError elsewhere.
    """
    folder = Path("conf")
    if not (folder / "dataset").is_dir():
        raise ConfigError("call this in the project's root folder, where conf/ is")
    return folder


def refuse_code_of_another() -> None:
    """Raise ConfigError if the code that runs is another project's.

    So it is in a project that was copied with its .venv, which still runs the first one's code.
    """
    local_code = Path("pipeline/cli")
    running = Path(__file__).resolve().parent
    project = running.parents[1]
    if (
        local_code.is_dir()
        and local_code.resolve() != running
        and (project / "pyproject.toml").is_file()
    ):
        raise ConfigError(
            f"the code of {project} would run, not this folder's: `rm -r .venv && make install`"
        )


def read_studies() -> dict[str, dict[str, Any]]:
    """The studies of conf/studies.yaml by name; raises ConfigError where it holds none."""
    path = conf_folder() / "studies.yaml"
    studies = read_yaml(path).get("studies")
    if (
        isinstance(studies, dict)
        and studies
        and all(isinstance(study, dict) for study in studies.values())
    ):
        return studies
    raise ConfigError(
        f"{path}: expected `studies:` with a study for each data set; `yearloc use campus` writes "
        "it anew"
    )
