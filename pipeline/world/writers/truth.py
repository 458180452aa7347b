"""What no robot could know, beside the logs: what each point is, and what changed over the year."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pipeline.world.driving.lidar import Returns
from pipeline.world.layout.events import Event


@dataclass(frozen=True)
class TruthWriter:
    """Writes kinds/<utime>.npy, uint8 in the scan's own order, and year.json."""

    folder: Path

    def open(self) -> None:
        """Make the folder."""
        self._kinds().mkdir(parents=True, exist_ok=True)

    def write_scan(self, utime: int, returns: Returns) -> None:
        """Write what each point of a scan lies on."""
        np.save(self._kinds() / f"{utime}.npy", returns.kind)

    def write_year(self, day: int, events: Sequence[Event], plan: dict[str, float]) -> None:
        """Write the events of the whole year, the sequence's own day in it, and how its route relates to the training one."""
        year = {"day": day, "events": [asdict(event) for event in events], "plan": plan}
        (self.folder / "year.json").write_text(json.dumps(year, indent=1) + "\n")

    def _kinds(self) -> Path:
        return self.folder / "kinds"
