"""The interface of all writers of logs, the ground truth of a drive first, then each of its scans;
and the writer of labels that no robot could record beside them: the kind of each point, and the
events of the year.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pipeline.core.frames import Poses, rpy
from worlds import Floats
from worlds.driving.drive import Drive
from worlds.driving.lidar import Returns
from worlds.layout.events import Event
from worlds.seeds import Generators


@dataclass
class Writer(ABC):
    """Writes one sequence into its folder, in the format of a data set."""

    folder: Path
    sequence: str
    body_T_sensor: Poses
    """(4, 4) the scanner's pose on the robot."""
    in_order: ClassVar[bool] = False
    """Whether scans must be written in order by one process. Otherwise any worker may write them,
    in any order."""

    @abstractmethod
    def write_ground_truth(self, drive: Drive, reference: Drive, generators: Generators) -> None:
        """Create the folders, and write everything except the scans.

        That is the ground truth, which are the poses of `reference`; odometry of the true poses of
        `drive`, whose errors are drawn from `generators`; and the calibration.
        """

    @abstractmethod
    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write scan number `scan`, taken at `utime` in microseconds; the ground truth comes
        before."""

    def close(self) -> None:
        """Finish the log; there is nothing to do where each scan is a file of its own."""
        return


def xyzrpy(poses: Poses) -> Floats:
    """Rows (n, 6) of x, y, z in metres and roll, pitch, yaw in radians of poses (n, 4, 4)."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])


@dataclass(frozen=True)
class GroundTruthWriter:
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
