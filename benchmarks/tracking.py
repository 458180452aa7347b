"""How soon a robot that is put down anywhere on a recorded day knows where it is, and how often it is wrong.

`python -m benchmarks.tracking SITE LOG [STARTS]`: from random scans of a log with truth and odometry, by single scans and by
following the path (`yearloc localize --track`), with 1 % and 5 % of drift added to the odometry; then the robot is carried
elsewhere once it is sure. Starts where training never was count too: there, every accepted fix is wrong.
"""

import sys
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.online.inputs import Scan, scans
from pipeline.online.site import Fix, Site
from pipeline.online.tracking import Tracker
from pipeline.posing.fix import Fix as Registered
from pipeline.posing.verdict import right

LONGEST, SURE, CARRIED_M, PROMISE = 60, 10, 50.0, 0.99
"""Scans until a start is given up; scans from the first fix until the robot is carried elsewhere, so far at least."""


class Day:
    """A log whose global fixes are computed once."""

    def __init__(self, site: Site, log: list[Scan]) -> None:
        self.site, self.log = site, log
        self.points = lru_cache(None)(lambda row: log[row].points())
        self.everywhere = lru_cache(None)(self._everywhere)
        self.xy_m = np.array([scan.world_T_scan[:2, 3] for scan in log])

    def _everywhere(self, row: int) -> Registered:
        points_m = self.points(row)
        return self.site.register(points_m, self.site.rank(points_m).xy_m[0].astype(np.float64))


class Follower(Tracker):
    """A tracker whose global fixes come from the day."""

    def __init__(self, day: Day) -> None:
        super().__init__(day.site, PROMISE)
        self.day, self.row = day, 0

    def _everywhere(self, points_m: NDArray[np.float64]) -> Registered:
        return self.day.everywhere(self.row)


def single(day: Day, rows: list[int], drift: float, rng: np.random.Generator) -> Iterator[tuple[int, Fix]]:
    for row in rows:
        yield row, day.site.judge(day.everywhere(row), PROMISE)


def followed(day: Day, rows: list[int], drift: float, rng: np.random.Generator) -> Iterator[tuple[int, Fix]]:
    follower, scale = Follower(day), 1 + drift * rng.choice([-1, 1])
    for before, row in zip([rows[0], *rows], rows, strict=False):
        step = np.eye(4)
        if row == before + 1:
            step = np.linalg.inv(day.log[before].odom_T_scan) @ day.log[row].odom_T_scan
            length_m = np.linalg.norm(step[:3, 3])
            step[:3, 3] *= scale
            step[:3, :3] = step[:3, :3] @ Rotation.from_rotvec([0, 0, drift * length_m * 0.1 * rng.choice([-1, 1])]).as_matrix()
        follower.row = row
        yield row, follower.localize(day.points(row), step)


def tried(day: Day, way: object, starts: int, drift: float) -> dict[str, list[float]]:
    """By start: metres and scans to the first right accepted fix, before and after being carried elsewhere; and counts."""
    rng, found = (
        np.random.default_rng(0),
        {name: list[float]() for name in ("first", "scans", "again", "accepted", "wrong", "never")},
    )
    for start in rng.integers(0, len(day.log) - LONGEST, starts).tolist():
        far = np.flatnonzero(np.linalg.norm(day.xy_m[:-LONGEST] - day.xy_m[start], axis=1) > CARRIED_M)
        rows = [*range(start, start + LONGEST), *range(carried := int(rng.choice(far)), carried + LONGEST)]
        first_at, again = 0, False
        for number, (row, fix) in enumerate(way(day, rows, drift, rng)):  # type: ignore[operator]
            if fix.verdict != "accepted":
                continue
            good = bool(right(fix.world_T_sensor[None], day.log[row].world_T_scan[None])[0])
            found["accepted"].append(1.0)
            found["wrong"].append(float(not good))
            part = rows[:LONGEST] if number < LONGEST else rows[LONGEST:]
            metres = float(np.linalg.norm(np.diff(day.xy_m[part[0] : row + 1], axis=0), axis=1).sum())
            if good and number < LONGEST and not first_at:
                first_at = number + 1
                found["first"].append(metres)
                found["scans"].append(number + 1)
            if good and number >= LONGEST and not again:
                again = True
                found["again"].append(metres)
        found["never"].append(float(not first_at))
    return found


def main(path: str, source: str, starts: str = "500") -> None:
    site = Site.open(path)
    log = [scan for scan in scans(source, site.about["reader"], 0.0) if np.isfinite(scan.world_T_scan).all()]
    day = Day(site, log)
    for name, way, drift in (("single scans", single, 0.0), ("followed", followed, 0.01), ("followed", followed, 0.05)):
        found = tried(day, way, int(starts), drift)
        metres = "  ".join(
            f"{what} {np.median(found[key]):5.1f} m, 90 % within {np.percentile(found[key], 90):5.1f} m"
            for what, key in (("first", "first"), ("carried", "again"))
            if found[key]
        )
        wrong = f"{sum(found['wrong']):.0f} of {len(found['accepted'])} accepted wrong ({np.mean(found['wrong']):.2%})"
        never = f"{np.mean(found['never']):.1%} without a fix in {LONGEST} scans"
        print(f"{name:<12} drift {drift:4.0%}: {metres}; {wrong}; {never}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
