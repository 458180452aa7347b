"""Makes the site and the scans of `yearloc example`, and queries the site with more of those days.

`python -m benchmarks.example SITE LOGS`: `make example` has packed and exported the demo's site
before, and LOGS are the simulated logs that it was made of. The new site has the map of the first
STRETCH_M of training, with the same network and verdict. Scans are chosen by where they were taken
and by what has changed there, never by what the site answers.
"""

import sys
from collections import Counter
from datetime import date
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.frames import step_lengths_m, transformed
from pipeline.core.replacing import replace
from pipeline.online.example import SCANS, SITE, ExampleScan
from pipeline.online.inputs import Scan, ScanOptions
from pipeline.online.site import Site
from pipeline.online.site_file import Arrays, read, write
from pipeline.posing.verdict import OF_SCANS

STRETCH_M = 300.0
SEEN_M = 5.0
"""A place counts as learned if training passed nearer than this."""
WALL_M = 0.5
"""Points below are ground, which does not change."""
EVERY = 5
"""Every EVERY-th scan of a drive near the stretch is localised, and half as many away from it."""
CHANGED_M = 0.5
"""A point has changed if the map has no point nearer than this."""


def main(whole: Path, logs: Path) -> None:
    """Cut the map, choose scans, write both, and count the answers."""
    parts = read(whole)
    write(SITE, parts._replace(arrays=stretch(parts.arrays)))
    site = Site.open(SITE)
    learned_day = site.description.provenance.train
    days = [path.name for path in sorted(logs.iterdir()) if path.is_dir()]
    later = [day for day in days if day != learned_day]
    options = ScanOptions(site.description.reader, site.description.sensor.lift_m)
    drives = {day: list(options.scans(str(logs / day), Counter())) for day in later}
    last = later[-1]
    chosen = {
        "learned_place": (middle(site, drives[last]), "a place that was learned"),
        "changed_place": (most_changed(site, drives[last]), "a learned place that has changed"),
        "elsewhere": (farthest(site, drives[last]), "a place that the map does not have"),
    }
    entries = {}
    for name, (scan, what) in chosen.items():
        after = (date.fromisoformat(last) - date.fromisoformat(learned_day)).days
        example = ExampleScan(name, last, f"{after} days later, {what}", scan.world_T_scan)
        np.save(example.path, scan.points().astype(np.float32))
        entries[name] = {
            "day": example.day,
            "about": example.about,
            "world_T_scan": scan.world_T_scan.round(9).tolist(),
        }
    with replace(SCANS) as scratch:
        text = yaml.safe_dump(entries, sort_keys=False, default_flow_style=None, width=100)
        scratch.write_text(f"# Simulated. Written by `make example`.\n{text}", encoding="utf-8")
    for day, drive in drives.items():
        print(f"{day}: {answered(site, drive)}", flush=True)


def stretch(arrays: Arrays) -> Arrays:
    """The arrays of a map without the submaps after the first STRETCH_M of path."""
    steps_m = step_lengths_m(arrays["world_T_anchor"][:, :2, 3])
    count = int(np.searchsorted(np.cumsum(steps_m), STRETCH_M)) + 1
    return {
        **arrays,
        "world_T_anchor": arrays["world_T_anchor"][:count],
        "offsets": arrays["offsets"][: count + 1],
        "points": arrays["points"][: arrays["offsets"][count]],
    }


def away_m(site: Site, drive: list[Scan]) -> NDArray[np.float64]:
    """How far (scan,) each was taken from the nearest submap of training."""
    tree = KDTree(site.targets.world_T_anchor[:, :2, 3])
    return np.asarray(tree.query(np.stack([scan.world_T_scan[:2, 3] for scan in drive]))[0])


def middle(site: Site, drive: list[Scan]) -> Scan:
    """The scan half way along the learned part of a drive."""
    seen = np.flatnonzero(away_m(site, drive) < SEEN_M)
    return drive[int(seen[len(seen) // 2])]


def farthest(site: Site, drive: list[Scan]) -> Scan:
    """The scan farthest from training."""
    return drive[int(away_m(site, drive).argmax())]


def most_changed(site: Site, drive: list[Scan]) -> Scan:
    """The scan of a learned place with the smallest share of points that the map has too."""
    parts = [
        transformed(pose, site.targets.points_m(row))
        for row, pose in enumerate(site.targets.world_T_anchor)
    ]
    tree = KDTree(np.concatenate(parts))
    shares = np.full(len(drive), np.inf)
    for row in np.flatnonzero(away_m(site, drive) < SEEN_M).tolist():
        points_m = drive[row].points()
        points_m = points_m[points_m[:, 2] > WALL_M]
        pose = drive[row].world_T_scan
        distance_m, _ = tree.query(transformed(pose, points_m))
        shares[row] = np.mean(np.asarray(distance_m) < CHANGED_M)
    return drive[int(shares.argmin())]


def answered(site: Site, drive: list[Scan]) -> str:
    """Count what the site answers to some scans of a drive, and how often that is right.

    An accepted pose is right within 2 m and 5°, another answer within 15 m of the true place.
    """
    counts: Counter[str] = Counter()
    distances_m = away_m(site, drive)
    for is_known in (True, False):
        rows = np.flatnonzero((distances_m < SEEN_M) == is_known)
        for row in rows[:: EVERY if is_known else 2 * EVERY].tolist():
            scan = drive[row]
            fix = site.localize(scan.points())
            away = np.linalg.norm(fix.world_T_sensor[:2, 3] - scan.world_T_scan[:2, 3])
            good = OF_SCANS.right(fix.world_T_sensor[None], scan.world_T_scan[None])[0]
            is_right = good if fix.verdict == "accepted" else away < OF_SCANS.near_m
            where = "learned" if is_known else "not in the map"
            counts[f"{where}, {fix.verdict}, {'right' if is_right else 'wrong'}"] += 1
    return "; ".join(f"{count} {what}" for what, count in sorted(counts.items()))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
