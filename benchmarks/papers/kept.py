"""The kept tables of results: reads them from docs/papers, and writes new ones there.

Each is a csv with the rows and columns of a table of results that the papers' findings (`claims`)
read, and no others; a yaml beside it says what made it. `Kept` judges all findings by them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from benchmarks.papers.claims import CLAIMS
from benchmarks.papers.judging import Outcome, Tables
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.replacing import replace
from pipeline.evaluation.rows import COLUMN_TYPES, COLUMNS, FLOAT_COLUMNS
from pipeline.running.texts import read_yaml
from pipeline.studies.study import Study

FOLDER = Path("docs/papers")
KEPT_COLUMNS = tuple(name for name in COLUMNS if name not in ("dataset", "model", "days"))
"""The columns that are kept."""
DIGITS = 6
"""Decimals of the numbers that are kept."""
NAMES = ("nway", "street", "compare", "real")
"""The tables that findings read (see `claims`)."""
STUDY_KEYS = (
    "experiment",
    "world",
    "root",
    "train",
    "tests",
    "budget",
    "methods",
    "perturbed",
    "cells",
)
"""The settings of each study that the yaml has."""


@dataclass(frozen=True)
class Kept:
    """The kept tables, what made each, and what they say of each finding."""

    frames: Mapping[str, pd.DataFrame]
    """The tables by name."""
    origins: Mapping[str, Mapping[str, Any]]
    """The yaml of each table: `use`, the words of `yearloc use`; `cost`; `made`, a date; `machine`;
    `studies`."""
    outcomes: Mapping[str, Outcome] = field(init=False)
    """The outcome of each claim by name."""

    def __post_init__(self) -> None:
        """Judge all findings."""
        tables = Tables(dict(self.frames))
        outcomes = {claim.name: claim.measure(tables) for claim in CLAIMS}
        object.__setattr__(self, "outcomes", outcomes)

    def simulated(self, table: str, study: str) -> bool:
        """Whether a study's logs are simulated."""
        frame = self.frames[table]
        return bool(frame.loc[frame["study"] == study, "simulated"].iloc[0])


def read(folder: Path) -> Kept:
    """Read the kept tables of a folder.

    Tables that are not there are left out. Raises ArtifactError for a file that is no table of
    results, or has no yaml.
    """
    frames = {}
    origins = {}
    for name in NAMES:
        path = folder / f"{name}.csv"
        if path.is_file():
            frames[name] = _read_table(path)
            origins[name] = _read_origin(path)
    return Kept(frames, origins)


def _read_table(path: Path) -> pd.DataFrame:
    """Read a kept table; raises ArtifactError for a file that is none."""
    try:
        return pd.read_csv(
            path,
            dtype={name: COLUMN_TYPES[name] for name in KEPT_COLUMNS},
            keep_default_na=False,
            na_values={name: [""] for name in FLOAT_COLUMNS},
        )[[*KEPT_COLUMNS]]
    except (ValueError, KeyError) as error:
        raise ArtifactError(
            f"{path}: not a kept table of results ({str(error).strip()}); `yearloc results "
            f"--keep {path.stem}` rewrites it"
        ) from None


def _read_origin(path: Path) -> Mapping[str, Any]:
    """Read the yaml beside a kept table; raises ArtifactError if there is none."""
    yaml_path = path.with_suffix(".yaml")
    if not yaml_path.is_file():
        raise ArtifactError(
            f"{yaml_path}: no such file, which says what made {path.name}; "
            f"`yearloc results --keep {path.stem}` writes it"
        )
    return read_yaml(yaml_path)


def kept_rows(name: str, table: pd.DataFrame) -> pd.DataFrame:
    """The rows of a table of results that findings would read if it were kept by this name.

    Raises ConfigError for a name that no finding reads, and for a table without such rows.
    """
    if name not in NAMES:
        raise ConfigError(f"--keep {name}: expected one of {', '.join(NAMES)}")
    # Judge all findings, to see which rows are read.
    tables = Tables({name: table})
    for claim in CLAIMS:
        claim.measure(tables)
    rows = table.loc[sorted(tables.used[name]), [*KEPT_COLUMNS]]
    if rows.empty:
        raise ConfigError(
            f"--keep {name}: the studies in use have none of the numbers that the papers' findings "
            "read of this table; `make papers` measures them"
        )
    return rows


def keep(
    name: str,
    table: pd.DataFrame,
    studies: Mapping[str, Study],
    made: str,
    machine: str,
    folder: Path = FOLDER,
) -> Path:
    """Write a table of results as a kept one, with its yaml; returns the path of the csv.

    `use` and `cost` of an earlier yaml stay in it. Raises ConfigError as `kept_rows` does, and if
    that `use` names other data sets than the studies in use.
    """
    rows = kept_rows(name, table)
    path = folder / f"{name}.csv"
    earlier = read_yaml(path.with_suffix(".yaml")) if path.with_suffix(".yaml").is_file() else {}
    used = [word for word in str(earlier.get("use", "")).split() if "=" not in word]
    if used and sorted(used) != sorted(studies):
        raise ConfigError(
            f"--keep {name}: {path.with_suffix('.yaml')} is of {', '.join(used)}, and "
            f"{', '.join(studies)} are in use; call `yearloc use {earlier['use']}`"
        )
    origin: dict[str, Any] = {key: earlier[key] for key in ("use", "cost") if key in earlier}
    origin |= {"made": made, "machine": machine}
    origin["studies"] = {name: _study_settings(study) for name, study in studies.items()}
    folder.mkdir(parents=True, exist_ok=True)
    with replace(path) as scratch:
        rows.round(DIGITS).to_csv(scratch, index=False)
    with replace(path.with_suffix(".yaml")) as scratch:
        scratch.write_text(
            yaml.safe_dump(origin, sort_keys=False, allow_unicode=True, width=1000),
            encoding="utf-8",
        )
    return path


def _study_settings(study: Study) -> dict[str, Any]:
    """The settings of a study for the yaml; for its methods: names, views, variants and seeds."""
    table = study.table()
    settings = {key: table[key] for key in STUDY_KEYS if key in table}
    settings["methods"] = [
        {key: method[key] for key in ("name", "view", "variants", "seeds") if key in method}
        for method in table["methods"]
    ]
    return settings
