"""How good verdicts on poses are, day by day.

`python -m benchmarks.verdicts ARTIFACTS STUDY/GRID/MODEL [SITE]` reads the poses that `dvc repro`
built. It prints for each day how many of the seen queries (training within 5 m) have a right pose
(2 m and 5°); the calibration error of the probability over ten bins of equally many poses; and the
coverage, the share of all queries that could be accepted at a precision by a threshold chosen
afterwards; and of the poses accepted at .99, how many have the true pose within the ellipsoids of
50, 90 and 95 % of their covariance, in six dimensions and in x and y. Then follows a row for each
target precision: the accepted share of the right poses; the wrong poses of the accepted ones, with
an exact 95 % interval; and how many queries are called near (within 15 m) or ambiguous, with how
many of the near ones are right.

Two worlds are built to alias, and nothing was or may be chosen on them (docs/notes/worlds.md):

    yearloc use campus world=terraces methods=sci_ring budget=minutes && yearloc repro
    python -m benchmarks.verdicts artifacts campus/10m/sci_ring
    yearloc use campus world=colonnade methods=sci_ring budget=minutes && yearloc repro
    python -m benchmarks.verdicts artifacts campus/10m/sci_ring

With the file of a packed SITE it localises every twentieth query: CPU time of one thread from
points to fix, drawing and ranking included.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from pipeline.core import schemas, store
from pipeline.evaluation.evaluations import ELLIPSOIDS
from pipeline.mapping.gathering import submap_points
from pipeline.online.site import Site
from pipeline.posing.covariances import largest_squares, normalised_squares, pose_errors
from pipeline.posing.learned_verdict import VERDICT
from pipeline.posing.verdict import CLAIMS, OF_SCANS, TARGET_PRECISIONS

SEEN_M = 5.0
EVERY = 20
BINS = 10
X_Y = slice(3, 5)
"""x and y among the six dimensions of a covariance."""


def interval(wrong: int, accepted: int) -> tuple[float, float]:
    """The 95 % interval of Clopper and Pearson."""
    if not accepted:
        return 0.0, 1.0
    low = beta.ppf(0.025, wrong, accepted - wrong + 1) if wrong else 0.0
    high = beta.ppf(0.975, wrong + 1, accepted - wrong) if wrong < accepted else 1.0
    return float(low), float(high)


def calibration(probability: NDArray[np.float64], good: NDArray[np.bool_]) -> float:
    """The mean gap between probability and share right, over bins of equally many poses."""
    order = np.argsort(probability, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if len(part)]
    off = [len(part) * abs(float(probability[part].mean() - good[part].mean())) for part in parts]
    return sum(off) / max(len(order), 1)


def coverage(error: NDArray[np.float64], good: NDArray[np.bool_], precision: float) -> float:
    """The largest share of all queries (q,) that can be accepted at a precision, surest first."""
    order = np.argsort(error, kind="stable")
    kept = np.flatnonzero(np.cumsum(good[order]) >= precision * np.arange(1, len(good) + 1))
    return float(kept.max(initial=-1) + 1) / max(len(good), 1)


def ellipsoids(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> str:
    """The shares of errors (n, d) within the ellipsoids of ELLIPSOIDS of covariances (n, d, d)."""
    squares = normalised_squares(errors, covariances)
    largest_of_each = largest_squares(ELLIPSOIDS, errors.shape[1])
    return " ".join(f"{(squares < largest).mean():.3f}" for largest in largest_of_each)


def day(
    fixes: schemas.Fixes, world_T_true: NDArray[np.float64], world_T_anchor: NDArray[np.float64]
) -> list[str]:
    """The rows of one day."""
    n = len(world_T_true)
    world_T_query = fixes.load("world_T_query")[:n]
    errors = fixes.load("novelty")[:n, : len(CLAIMS)].astype(np.float64)  # probabilities
    away_m = np.linalg.norm(world_T_true[:, None, :2, 3] - world_T_anchor[:, :2, 3], axis=2).min(
        axis=1
    )
    good = OF_SCANS.right(world_T_query, world_T_true)
    seen = away_m < SEEN_M
    near = (
        np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:, :2, 3], axis=1) < OF_SCANS.near_m
    )
    calibration_error = calibration(1 - errors[:, 0], good)
    covered = ", ".join(f"{coverage(errors[:, 0], good, p):.3f} at {p}" for p in TARGET_PRECISIONS)
    rows = [
        f"{n} queries, {seen.sum()} seen, right of these {good[seen].mean():.3f}; calibration "
        f"error {calibration_error:.3f}",
        f"  of all queries, in hindsight, by the error probability alone: {covered}",
    ]
    accepted = errors[:, 0] < fixes.reject_from()
    if accepted.any():
        off = pose_errors(world_T_query[accepted], world_T_true[accepted])
        covariances = fixes.load("covariance")[:n][accepted]
        in_six = ellipsoids(off, covariances)
        in_xy = ellipsoids(off[:, X_Y], covariances[:, X_Y, X_Y])
        rows.append(f"  within the ellipsoids of .5, .9, .95: {in_six}; of x and y: {in_xy}")
    thresholds = zip(
        *(fixes.pose_thresholds, fixes.place_thresholds, fixes.several_thresholds),
        strict=True,
    )
    for target_precision, (pose, place, several) in zip(
        fixes.target_precisions, thresholds, strict=True
    ):
        accepted = errors[:, 0] < pose
        close = ~accepted & (errors[:, 1] < place)
        open_ = ~accepted & ~close & (errors[:, 2] < several)
        wrong = int((accepted & ~good).sum())
        low, high = interval(wrong, int(accepted.sum()))
        recall = (accepted & good).sum() / max(good.sum(), 1)
        rows.append(
            f"  {target_precision:<6} of right {recall:.3f}, of seen "
            f"{(accepted & good & seen).sum() / max(seen.sum(), 1):.3f}; wrong {wrong:>2} of "
            f"{accepted.sum():<3} ({low:.3f} to {high:.3f}); near {close.sum():>2}, true "
            f"{(close & near).sum():>2}; ambiguous {open_.sum():>2}"
        )
    return rows


def times_ms(site: Site, scans: schemas.Scans, submaps: schemas.Submaps) -> str:
    """Mean, median and 95 % of every EVERY-th query."""
    took: list[float] = []
    for row in range(0, submaps["scans"].shape[0], EVERY):
        points_m = next(iter(submap_points(scans, submaps, slice(row, row + 1))))
        start = time.process_time()
        site.localize(points_m, target_precision=None)
        took.append(1e3 * (time.process_time() - start))
    return (
        f"  CPU-ms mean {np.mean(took):.0f}, median {np.median(took):.0f}, 95 % "
        f"{np.quantile(took, 0.95):.0f}"
    )


def main(artifacts: str, model: str, site: str = "") -> None:
    root = Path(artifacts)
    study = model.split("/")[0]
    (mapped,) = (root / "map" / study).glob("*.zarr")
    world_T_anchor = store.read(mapped, schemas.Maps).load("world_T_anchor")
    opened = Site.open(site) if site else None
    for path in sorted((root / "poses" / model).glob("*.zarr")):
        if path.stem == VERDICT:
            continue  # the verdict that was learned for them
        submaps = store.read(root / "submaps" / study / path.name, schemas.Submaps)
        fixes = store.read(path, schemas.Fixes)
        first, *rows = day(fixes, submaps.load("world_T_anchor"), world_T_anchor)
        print(f"{study} {path.stem}: {first}", *rows, sep="\n", flush=True)
        if opened:
            scans = store.read(root / "scans" / study / path.name, schemas.Scans)
            times_ms(opened, scans, submaps)  # compiles kernels, fills caches
            print(times_ms(opened, scans, submaps), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
