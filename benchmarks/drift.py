"""Effect of the odometry of a log on a submap: drift over its window, and the difference of its
Scan Context from the true one.

python -m benchmarks.drift artifacts/scans/town/*.zarr
"""

import sys

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core import schemas, store
from pipeline.core.progress import Progress
from pipeline.mapping.gathering import Gathering
from pipeline.mapping.submaps import Accumulated
from pipeline.views.scan_context import ScanContext

EVERY = 10
"""Scan Contexts are computed for one of so many submaps."""


def measure(path: str) -> str:
    """One sequence: medians and 90th percentiles."""
    scans = store.read(path, schemas.Scans)
    submaps = Accumulated().cut(scans, Progress())
    truth = scans.load("world_T_scan")
    known = np.isfinite(truth).all(axis=(1, 2))
    unknown = np.concatenate([[0], np.cumsum(~known)])
    whole = np.flatnonzero(unknown[submaps.scans + 1] == unknown[submaps.first])
    first = submaps.first[whole]
    last = submaps.scans[whole]
    ground_m = submaps.ground_m[whole]
    newest_T_oldest = np.linalg.inv(truth[last]) @ truth[first]
    odom_T_scan = scans.load("odom_T_scan")
    error = np.linalg.inv(newest_T_oldest) @ np.linalg.inv(odom_T_scan[last]) @ odom_T_scan[first]
    drift_m = np.linalg.norm(error[:, :3, 3], axis=1)
    drift_deg = np.degrees(np.abs(Rotation.from_matrix(error[:, :3, :3]).as_euler("ZYX")[:, 0]))

    def contexts(layout: schemas.PoseColumn) -> list[NDArray[np.float32]]:
        rows = slice(None, None, EVERY)
        return list(
            map(
                ScanContext(),
                Gathering(scans, layout, first[rows], last[rows], ground_m[rows], submaps.used),
            )
        )

    cosines = np.array(
        [
            column_cosine(a, b)
            for a, b in zip(contexts("odom_T_scan"), contexts("world_T_scan"), strict=True)
        ]
    )
    lines = [f"{path}: {len(whole)} windows with a true pose throughout, of {len(submaps.scans)}"]
    for name, values in (
        ("drift [m]", drift_m),
        ("drift of heading [deg]", drift_deg),
        ("column cosine", cosines),
    ):
        middle, low, high = np.percentile(values, (50, 10, 90))
        lines.append(
            f"  {name:<24} median {middle:.3f}, 10th to 90th percentile {low:.3f}–{high:.3f}"
        )
    return "\n".join(lines)


def column_cosine(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Mean cosine of the columns that hold something in both (METHODS 1.3, unshifted)."""
    norms = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0)
    engaged = norms > 0
    return float(((a * b).sum(axis=0)[engaged] / norms[engaged]).mean())


if __name__ == "__main__":
    for name in sys.argv[1:]:
        print(measure(name))
