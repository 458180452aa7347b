"""The project that the commands are called in: its conf folder and its studies."""

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.core.errors import ConfigError

if TYPE_CHECKING:
    from pipeline.studies.study import Study


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


def read_studies() -> "dict[str, Study]":
    """The studies of conf/studies.yaml by name; raises ConfigError where it holds none."""
    from pipeline.studies import studies_file

    return studies_file.read_studies(conf_folder())
