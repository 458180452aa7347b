"""How real simulated scans are: `python -m benchmarks.realism [picture.png]
ARTIFACTS/STUDY/SEQUENCE …`, recorded and simulated.

Of the first submaps of each sequence it prints what a scan is like: its points, how far they lie,
how many lie on the ground, how rough the surfaces above it are, and the widest arc without a point.
Then it cuts each to 3,000 points, draws Scan Contexts and prints how full they are; how fast they
change along the path, as the median distance of two that are so many metres apart; and how alike
different places look: the distance that one in twenty pairs over 100 m apart stays below. A file of
NCLT's velodyne_sync may be named too; of it only the first half is known.

`python -m benchmarks.realism full LOG …` prints how full scans, bird-views and Scan Contexts are,
side by side: a LOG is a world's yaml, KITTI's folder of a sequence with poses, the folder of NCLT's
key frames, or one scan of either.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks import fullness
from pipeline.core import schemas, store
from pipeline.formats import nclt
from pipeline.mapping.gathering import submap_points
from pipeline.matching.shifts import Spectra
from pipeline.views.scan_context import ScanContext

POINTS = 3000
SUBMAPS = 400
QUERIES = 60
APART_M = (1, 2, 3, 5, 8, 12, 20, 30, 50)
FAR_M = 100.0
NEIGHBOURS = 12
ROUGH_M = (3.0, 30.0)
ROUGH_ABOVE_M = 0.5
EVERY = 40
"""Roughness is that of points so far away and so high, about the plane through their nearest ones,
of every so-manieth submap."""
VIEW = ScanContext(voxel_m=0.0, min_points=1, beyond="drop")


def scan_like(clouds: list[NDArray[np.float64]]) -> dict[str, float]:
    """Medians over clouds (n, 3) with the ground at 0."""
    reach_m = [np.hypot(*cloud[:, :2].T) for cloud in clouds]
    sectors = [np.sort(np.arctan2(cloud[:, 1], cloud[:, 0])) for cloud in clouds]
    rough = np.array([roughness(cloud) for cloud in clouds[::EVERY]])
    return {
        "points": float(np.median([len(cloud) for cloud in clouds])),
        "range": float(np.median([np.median(r_m) for r_m in reach_m])),
        "below .3 m": float(np.median([(cloud[:, 2] < 0.3).mean() for cloud in clouds])),
        "rough": float(np.nanmedian(rough[:, 0])),
        "scattered": float(np.nanmedian(rough[:, 1])),
        "gap °": float(
            np.median([np.rad2deg(np.diff(np.append(s, s[0] + 2 * np.pi)).max()) for s in sectors])
        ),
    }


def roughness(cloud: NDArray[np.float64]) -> tuple[float, float]:
    """Median metres from the plane of a point's neighbours, and the share of points that look like
    no line or plane."""
    reach_m = np.hypot(*cloud[:, :2].T)
    points = cloud[
        (cloud[:, 2] > ROUGH_ABOVE_M) & (reach_m > ROUGH_M[0]) & (reach_m < ROUGH_M[1])
    ].astype(float)
    if len(points) <= NEIGHBOURS:
        return np.nan, np.nan
    near = points[KDTree(points).query(points, NEIGHBOURS + 1)[1]]
    near -= near.mean(1, keepdims=True)
    third, second, first = (
        np.linalg.eigvalsh(np.einsum("nki,nkj->nij", near, near) / (NEIGHBOURS + 1)).clip(min=0).T
    )
    return float(np.median(np.sqrt(third))), float(
        (third > np.maximum(second - third, first - second)).mean()
    )


def one_scan(path: Path) -> str:
    """A line of text on a file of NCLT's velodyne_sync."""
    points_m = nclt.decode(np.fromfile(path, np.uint16))
    return f"{path.name:44} {told(scan_like([points_m]))}"


def told(numbers: dict[str, float]) -> str:
    """Numbers in a row."""
    return "  ".join(f"{name} {value:7.3g}" for name, value in numbers.items())


def measured(place: Path) -> tuple[str, NDArray[np.float64]]:
    """A line of text on one sequence, and its distances at APART_M."""
    artifacts = place.parents[1]
    study = place.parent.name
    sequence = place.name
    scans = store.read(artifacts / "scans" / study / f"{sequence}.zarr", schemas.Scans)
    submaps = store.read(artifacts / "submaps" / study / f"{sequence}.zarr", schemas.Submaps)
    count = submaps["scans"].shape[0]
    rng = np.random.default_rng(0)
    first = min(count, SUBMAPS)
    clouds = list(submap_points(scans, submaps, slice(0, first)))
    thin = [cloud[rng.permutation(len(cloud))[:POINTS]] for cloud in clouds]
    heights_m = np.stack([VIEW(cloud) for cloud in thin])
    xy_m = submaps.load("world_T_anchor")[:first, :2, 3]
    spectra = Spectra.learned(heights_m)
    rows = np.arange(first)
    asked = np.linspace(0, first - 1, min(QUERIES, first)).astype(int)
    distances = np.stack([spectra.compare(heights_m[i], rows)[0] for i in asked])
    away_m = np.linalg.norm(xy_m[asked, None] - xy_m, axis=2)
    near = [(away_m > 0.7 * apart) & (away_m < 1.3 * apart) for apart in APART_M]
    curve = np.array([np.median(distances[pairs]) if pairs.any() else np.nan for pairs in near])
    far = distances[away_m > FAR_M]
    numbers = scan_like(clouds) | {
        "empty bins": (heights_m == 0).mean(),
        "empty sectors": (heights_m == 0).all(axis=1).mean(),
        "95 % height": np.percentile(np.concatenate(thin)[:, 2], 95),
        "far, 5 %": np.quantile(far, 0.05) if len(far) else np.nan,
    }
    steps = "  ".join(f"{value:.2f}" for value in curve)
    return (
        f"{f'{study} {sequence}':44} {told(numbers)}   at {', '.join(map(str, APART_M))} m: "
        f"{steps}",
        curve,
    )


def draw(curves: dict[str, NDArray[np.float64]], path: Path) -> None:
    """The distances over the metres between."""
    fig = Figure(figsize=(6.4, 3.6), layout="constrained")
    axis = fig.subplots()
    for name, curve in curves.items():
        axis.plot(APART_M, curve, marker="o", markersize=3, label=name)
    axis.set(
        xscale="log",
        xlabel="metres between two submaps",
        ylabel="Scan Context distance, median",
        ylim=(0, None),
    )
    axis.set_xticks(APART_M, [str(apart) for apart in APART_M])
    axis.legend(fontsize=7)
    fig.savefig(path, dpi=120)


def main(*words: str) -> None:
    """Print a line a sequence; draw them where a picture is named."""
    pictures = [word for word in words if word.endswith((".png", ".svg"))]
    if words[:1] == ("full",):
        for line in fullness.table(map(fullness.read, words[1:])):
            print(line, flush=True)
        return
    curves = {}
    for word in words:
        if word.endswith(".bin"):
            print(one_scan(Path(word)), flush=True)
        elif word not in pictures:
            line, curves[" ".join(Path(word).parts[-2:])] = measured(Path(word))
            print(line, flush=True)
    for picture in pictures:
        draw(curves, Path(picture))


if __name__ == "__main__":
    main(*sys.argv[1:])
