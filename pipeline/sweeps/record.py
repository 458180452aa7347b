"""One job of a sweep as JSON: its overrides, its metrics or its error, and which artifacts it built or reused."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline import store


@dataclass(frozen=True)
class Record:
    """One job, finished or failed; jobs may run on other machines, so each writes a file."""

    number: int
    overrides: Mapping[str, str]
    """Hydra's overrides, such as {"grid.cell_m": "5", "method": "sci"}."""
    dataset: str
    simulated: bool
    method: str
    database: str
    """MLflow's database, written once all jobs have ended."""
    error: str | None = None
    """Why it failed, in one line."""
    numbers: Mapping[str, Mapping[str, Any]] | None = None
    """Test sequence to its metrics.json."""
    held_out_auc: float | None = None
    """By cells, on the held-out blocks of training."""
    from_dvc: Mapping[str, int] = field(default_factory=dict)
    """Stage to the artifacts that DVC had built."""
    from_sweeps: Mapping[str, int] = field(default_factory=dict)
    """Stage to the artifacts that other jobs had built."""
    built: Mapping[str, int] = field(default_factory=dict)
    """Stage to the artifacts that this job built."""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    """Of the job's own process."""

    def write(self, folder: Path) -> None:
        """Whole or not at all."""
        with store.replace(folder / f"{self.number}.json") as scratch:
            scratch.write_text(json.dumps(asdict(self), indent=1))


def read(folder: Path) -> list[Record]:
    """The records of a sweep's folder, by job number."""
    records = [Record(**json.loads(path.read_text())) for path in folder.glob("*.json")]
    return sorted(records, key=lambda record: record.number)


def cost(records: Sequence[Record]) -> str:
    """One line: artifacts reused and built, failed jobs and CPU time."""
    parts = []
    for name in ("from_dvc", "from_sweeps", "built"):
        of: Counter[str] = sum((Counter(getattr(record, name)) for record in records), Counter())
        listed = ", ".join(f"{number} {stage}" for stage, number in of.items())
        parts.append(f"{of.total()} {name.replace('_', ' ')}" + (f" ({listed})" if listed else ""))
    failed, cpu_s = sum(record.error is not None for record in records), sum(record.cpu_s for record in records)
    return f"artifacts: {', '.join(parts)}; {len(records)} jobs, {failed} failed, {cpu_s:.0f} CPU-s"
