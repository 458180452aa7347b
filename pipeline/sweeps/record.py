"""The record of one job of a sweep: a JSON file with its overrides, and its results or its error.

Jobs may run on other machines, so each writes a file of its own. The sweep reads them all at its
end, to make its table and figure.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core.replacing import write_text
from pipeline.core.settings import filled
from pipeline.evaluation.rows import UNPERTURBED, pick, table

ORIGINS = ("from_dvc", "from_sweeps", "built")
"""Where a job's artifacts come from: DVC, earlier jobs, or the job itself."""


@dataclass(frozen=True)
class Record:
    """One job, finished or failed."""

    number: int
    """The job's number in the sweep, from 0."""
    overrides: Mapping[str, str]
    """The settings that the job changes, such as {"grid.cell_m": "5", "method": "sci"}."""
    dataset: str
    simulated: bool
    method: str
    error: str | None = None
    """Why the job failed, in one line."""
    rows: Sequence[Mapping[str, Any]] = ()
    """Rows of the table of results. Each is one number of one test sequence, for unperturbed
    queries. One further row, of no sequence, is the AUC on validation blocks of training."""
    from_dvc: Mapping[str, int] = field(default_factory=dict)
    """How many artifacts of each stage DVC had built already."""
    from_sweeps: Mapping[str, int] = field(default_factory=dict)
    """How many artifacts of each stage other jobs had built already."""
    built: Mapping[str, int] = field(default_factory=dict)
    """How many artifacts of each stage this job built."""
    wall_s: float = 0.0
    """Wall time of the job."""
    cpu_s: float = 0.0
    """CPU time of the job's own process."""

    @cached_property
    def unperturbed(self) -> pd.DataFrame:
        """Its rows as a table, without the rows on how further kinds of novelty reject."""
        return pick(table(self.rows), ask=UNPERTURBED)

    def values(self, protocol: str, number: str) -> list[float]:
        """The finite values of a number, one for each row that has it; empty for a failed job."""
        values = pick(self.unperturbed, protocol=protocol, number=number)["value"]
        return [*values[np.isfinite(values)]]

    @property
    def validation_auc(self) -> float | None:
        """The AUC by cells on validation blocks of training, or None if it was not measured."""
        return next(iter(self.values("cells", "validation_auc")), None)

    def write(self, folder: Path) -> None:
        """Write the record as `number`.json into a folder, whole or not at all.

        JSON has no NaN or infinity: such a number becomes null.
        """
        rows = [
            {
                name: value if not isinstance(value, float) or math.isfinite(value) else None
                for name, value in row.items()
            }
            for row in self.rows
        ]
        text = json.dumps({**asdict(self), "rows": rows}, indent=1, allow_nan=False)
        write_text(folder / f"{self.number}.json", text)


def read(folder: Path) -> list[Record]:
    """The records of a sweep's folder, by job number; a number that was not finite is NaN."""
    records = []
    for path in folder.glob("*.json"):
        content = json.loads(path.read_text(encoding="utf-8"))
        # Only numbers can be null in a row.
        rows = [
            {name: math.nan if value is None else value for name, value in row.items()}
            for row in content["rows"]
        ]
        records.append(filled(Record, {**content, "rows": rows}))
    return sorted(records, key=lambda record: record.number)


def cost(records: Sequence[Record]) -> str:
    """A line on what a sweep cost: artifacts reused and built, jobs, failed ones, CPU time."""
    counts_by_origin = []
    for origin in ORIGINS:
        counts = Counter[str]()
        for record in records:
            counts.update(getattr(record, origin))
        text = f"{counts.total()} {origin.replace('_', ' ')}"
        if counts:
            text += f" ({', '.join(f'{count} {stage}' for stage, count in counts.items())})"
        counts_by_origin.append(text)
    n_failed = sum(record.error is not None for record in records)
    cpu_s = sum(record.cpu_s for record in records)
    return (
        f"artifacts: {', '.join(counts_by_origin)}; {len(records)} jobs, {n_failed} failed, "
        f"{cpu_s:.0f} CPU-s"
    )
