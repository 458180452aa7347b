"""The kept tables of results, docs/papers/*.csv, each with a yaml beside it that says what made it.

A kept table holds the rows and columns that the findings read, and no others.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.replacing import replace
from pipeline.evaluation.rows import CASE_COLUMNS, COLUMN_TYPES, COLUMNS, FLOAT_COLUMNS
from pipeline.papers.claims import CLAIMS
from pipeline.papers.rules import Outcome, Tables
from pipeline.running.texts import read_yaml
from pipeline.studies.study import Study

FOLDER = Path("docs/papers")
KEPT = tuple(name for name in (*COLUMNS, *CASE_COLUMNS) if name not in ("dataset", "case", "days"))
DIGITS = 6
NAMES = ("nway", "street", "compare", "real")
"""Of the tables that findings read."""
TOLD = ("question", "world", "root", "train", "tests", "budget", "methods", "altered", "cells")
"""What a yaml says of each study."""


@dataclass(frozen=True)
class Kept:
    """The kept tables and what made each."""

    frames: Mapping[str, pd.DataFrame]
    origins: Mapping[str, Mapping[str, Any]]
    """By table: `use`, the words of `yearloc use`; `cost`; `made`, a date; `machine`; `studies`."""
    outcomes: Mapping[str, Outcome] = field(init=False)
    """By claim."""

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

    Raises ArtifactError for one that is no table of results or has no yaml.
    """
    frames = {}
    origins = {}
    for path in filter(Path.is_file, (folder / f"{name}.csv" for name in NAMES)):
        try:
            frames[path.stem] = pd.read_csv(
                path,
                dtype={name: COLUMN_TYPES[name] for name in KEPT},
                keep_default_na=False,
                na_values={name: [""] for name in FLOAT_COLUMNS},
            )[[*KEPT]]
        except (ValueError, KeyError) as error:
            raise ArtifactError(
                f"{path}: not a kept table of results ({str(error).strip()}); `yearloc results "
                f"--keep {path.stem}` writes it anew"
            ) from None
        if not path.with_suffix(".yaml").is_file():
            raise ArtifactError(
                f"{path.with_suffix('.yaml')}: no such file, which says what made {path.name}; "
                f"`yearloc results --keep {path.stem}` writes it"
            )
        origins[path.stem] = read_yaml(path.with_suffix(".yaml"))
    return Kept(frames, origins)


def kept_rows(name: str, table: pd.DataFrame) -> pd.DataFrame:
    """The rows of a table of results that the findings read of a kept table of this name.

    Raises ConfigError for a name that no finding reads, and for a table without such rows.
    """
    if name not in NAMES:
        raise ConfigError(f"--keep {name}: expected one of {', '.join(NAMES)}")
    tables = Tables({name: table})
    for claim in CLAIMS:
        claim.measure(tables)
    rows = table.loc[sorted(tables.used[name]), [*KEPT]]
    if rows.empty:
        raise ConfigError(
            f"--keep {name}: the studies in use have none of the numbers that the papers' findings "
            "read of this table; `make papers` asks for them"
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
    """Keep a table of results and say beside it what made it; returns the path of the csv.

    What its yaml says of use and cost stays. Raises ConfigError as `kept_rows` does, and where the
    yaml's `use` is of other data sets than the studies in use.
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
    origin["studies"] = {name: _told(study) for name, study in studies.items()}
    folder.mkdir(parents=True, exist_ok=True)
    with replace(path) as scratch:
        rows.round(DIGITS).to_csv(scratch, index=False)
    with replace(path.with_suffix(".yaml")) as scratch:
        scratch.write_text(
            yaml.safe_dump(origin, sort_keys=False, allow_unicode=True, width=1000),
            encoding="utf-8",
        )
    return path


def _told(study: Study) -> dict[str, Any]:
    """What the yaml says of a study; of its methods their names, views, variants and seeds."""
    table = study.table()
    origin = {key: table[key] for key in TOLD if key in table}
    origin["methods"] = [
        {key: method[key] for key in ("name", "view", "variants", "seeds") if key in method}
        for method in table["methods"]
    ]
    return origin
