"""Writes labels that no robot could record beside the logs: the kind of each point, and the events
of the year.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from worlds.driving.lidar import Returns
from worlds.layout.events import Event


@dataclass(frozen=True)
class TruthWriter:
    """Writes the labels of one sequence: year.json, and kinds/<utime>.npy for each scan."""

    folder: Path

    def write_scan(self, utime: int, returns: Returns) -> None:
        """Write the `shapes.Kind` of each point of a scan as uint8, in the order of its points."""
        np.save(self._kinds() / f"{utime}.npy", returns.kind)

    def write_year(self, day: int, events: Sequence[Event], plan: dict[str, float]) -> None:
        """Create the folders, and write year.json.

        It holds the events of the whole year, the `day` of the sequence in it, and the shares of
        its `plan`.
        """
        self._kinds().mkdir(parents=True, exist_ok=True)
        year = {"day": day, "events": [asdict(event) for event in events], "plan": plan}
        (self.folder / "year.json").write_text(
            json.dumps(year, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )

    def _kinds(self) -> Path:
        """The folder of the kinds of points."""
        return self.folder / "kinds"
