"""What the writers of a file a scan share."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pipeline.frames import Poses


@dataclass(frozen=True)
class FilesWriter:
    """One sequence and its own folder; each scan is a file, so any worker may write any of them, and nothing is left to close."""

    folder: Path
    sequence: str
    body_T_sensor: Poses
    in_order: ClassVar[bool] = False

    def close(self) -> None:
        """Nothing is open."""
