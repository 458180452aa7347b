"""A small simulated site, and three scans of a later day, which `yearloc example` localises in it.

The site is that of `make demo`, cut down to the first 300 m of its map. `make example` makes all of
these files again.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.core.frames import Poses

FOLDER = Path(__file__).parent
SITE = FOLDER / "campus.site"
SCANS = FOLDER / "scans.yaml"


@dataclass(frozen=True)
class ExampleScan:
    """A scan of a later day, stored in this folder, and where it was taken."""

    name: str
    day: str
    about: str
    """What is special about the place where it was taken."""
    world_T_scan: Poses
    """(4, 4) true pose, in the world of the site."""

    @property
    def path(self) -> Path:
        """The file of its points."""
        return FOLDER / f"{self.name}.npy"

    def points_m(self) -> NDArray[np.float32]:
        """Its points (n, 3) in metres: x forward, y left, z up, ground at z = 0."""
        return np.asarray(np.load(self.path))


def scans() -> list[ExampleScan]:
    """The three scans: of a learned place, of a changed one, and of a place not in the map."""
    entries = yaml.safe_load(SCANS.read_text(encoding="utf-8"))
    return [
        ExampleScan(
            name,
            entry["day"],
            entry["about"],
            np.array(entry["world_T_scan"], np.float64),
        )
        for name, entry in entries.items()
    ]
