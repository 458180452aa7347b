"""Finds the project that a command is called in: its conf folder, its studies and its code."""

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.studies.study import Study


def conf_folder() -> Path:
    """The project's conf folder; raises ConfigError unless called in the project's root folder."""
    folder = Path("conf")
    if not (folder / "dataset").is_dir():
        raise ConfigError("call this in the project's root folder, where conf/ is")
    return folder


def refuse_code_of_another() -> None:
    """Raise ConfigError if the code that runs is another project's than the one called in.

    That happens in a project that was copied with its .venv, which still runs the original's code.
    """
    local_code = Path("pipeline/cli")
    running_code = Path(__file__).resolve().parent
    project = running_code.parents[1]
    is_other_code = local_code.is_dir() and local_code.resolve() != running_code
    is_of_project = (project / "pyproject.toml").is_file()  # not an installed package
    if is_other_code and is_of_project:
        raise ConfigError(
            f"the code of {project} would run, not this folder's: `rm -r .venv && make install`"
        )


def read_studies() -> "dict[str, Study]":
    """The studies of conf/studies.yaml by name; raises ConfigError if it holds none."""
    from pipeline.studies import studies_file

    return studies_file.read_studies(conf_folder())


def named_model(name: str) -> "tuple[Study, str, str]":
    """The study, grid and method of STUDY/GRID/METHOD, such as campus/10m/sci_ring.

    Raises ConfigError for another form, and if there is no such study and grid.
    """
    try:
        study_name, grid, method = name.split("/")
    except ValueError:
        raise ConfigError(
            f"{name}: expected STUDY/GRID/METHOD, such as campus/10m/sci_ring"
        ) from None
    studies = read_studies()
    if study_name in studies and grid in studies[study_name].grid_names:
        return studies[study_name], grid, method
    choices = [
        f"{study.name}/{study_grid}"
        for study in studies.values()
        for study_grid in study.grid_names
    ]
    raise ConfigError(
        f"{name}: no such study and grid, expected one of "
        f"{', '.join(choices) or 'none: `yearloc use campus` first'}"
    )
