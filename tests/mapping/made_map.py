"""A made map on disk, and a drive through it with a table of poses."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.readers.posed_scans import HEADER
from tests.mapping.town import scan, town
from tests.posing.scene import planar

ELSEWHERE = 2
"""The scan that is of another town."""


def sloped(share: float = 0.1) -> NDArray[np.float64]:
    """The points (n, 3) of the town on a ground that rises along x."""
    points_m = town()
    points_m[:, 2] += share * points_m[:, 0]
    return points_m


def drive(folder: Path) -> Path:
    """A root with the map `town.pcd`, and the sequence `car` of six scans of it.

    Scan ELSEWHERE shows another town, at a place that the map has: its pose cannot be found.
    """
    write_pcd(folder / "town.pcd", town())
    rows = [",".join(HEADER)]
    for number in range(6):
        world_T_scan = planar(40 + 15 * number, 60 + 5 * number, 40 * number)
        scan_m = scan(town(seed=1 if number == ELSEWHERE else 0), world_T_scan)
        write_pcd(folder / f"car/scans/{number:03}.pcd", scan_m)
        values = [number, 1, 1.0, *world_T_scan[:3].ravel()]
        rows.append(",".join(f"{value:.9g}" for value in values))
    (folder / "car/truth.csv").write_text("\n".join(rows) + "\n")
    return folder


def write_pcd(path: Path, points_m: NDArray[np.float64]) -> None:
    """Write points (n, 3) as a binary PCD."""
    header = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points_m)}\nHEIGHT 1\nPOINTS {len(points_m)}\nDATA binary\n"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header.encode() + points_m.astype("<f4").tobytes())
