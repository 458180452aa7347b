"""Loops: places that a drive comes back to, by which its drift is found.

Candidates come from Scan Context (Kim and Kim, IROS 2018), not from the networks that are judged on
the map. The project's own search verifies them, look-alikes included. What odometry cannot have
drifted to is refused first: wrong loops that look right are refused by nothing else.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn, yaw
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, Share, check
from pipeline.posing.fix import Hypothesis
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.slam.keys import Keys
from pipeline.slam.odometry import share_standing
from pipeline.views.scan_context import ScanContext

NEAR_M = 8.0
"""A scan is registered with a key that was taken this near or nearer."""


@dataclass(frozen=True)
class Loop:
    """Two keys that show one place."""

    key: int
    """The earlier one."""
    later: int
    key_T_later: Poses
    """(4, 4)."""
    covariance: NDArray[np.float64]
    """(6, 6) of a turn in radians and a step in metres, in the later one's frame."""
    overlap: float
    """Share of what stands in one that the other has."""
    chance: float
    """By the search's own model, that the pose is right."""


@dataclass(frozen=True)
class LoopSearch:
    """How loops are found (conf/slam.yaml)."""

    view: ScanContext = field(default_factory=ScanContext)
    fixer: Fixer = field(default_factory=Fixer)
    every_m: Positive = 2.0
    """A key is kept after so much path."""
    asked_m: Positive = 4.0
    """A key is asked for loops after so much path."""
    back_m: Positive = 50.0
    """Path between the two keys of a loop, at least."""
    nearest: Count = 5
    """Candidates by Scan Context."""
    drift_m: NotNegative = 2.0
    drift: NotNegative = 0.06
    """Odometry is off by `drift_m` and this share of the path between, at most."""
    turn_deg: NotNegative = 5.0
    turn_deg_per_m: NotNegative = 0.3
    """Its heading is off by this much and so much a metre of path between, at most."""
    least: Share = 0.5
    """Of the median overlap of neighbouring scans, what the two keys of a loop overlap at least."""
    agreeing: Count = 3
    """Loops that have to agree where they join parts of a drive."""
    sure: Share = 0.95
    """Chance of each of these."""
    range_m: Positive = 100.0
    """Points farther from a key are left out."""

    def __post_init__(self) -> None:
        check(self, "loops")

    def within_drift(self, keys: Keys, targets: Targets, key: int) -> NDArray[np.bool_]:
        """Which keys (k,) of the same part one may stand beside again, by odometry."""
        between_m = keys.path_m[key] - keys.path_m
        away_m = np.linalg.norm(
            targets.world_T_anchor[:, :2, 3] - targets.world_T_anchor[key, :2, 3], axis=1
        )
        near = away_m < self.drift_m + self.drift * between_m + NEAR_M
        return np.asarray(near & (between_m > self.back_m) & (keys.parts == keys.parts[key]))

    def within(self, keys: Keys, usual_overlap: float, watch: Progress) -> list[Loop]:
        """The loops of a drive, within its parts and between them.

        `usual_overlap` is the median overlap of neighbouring scans.
        """
        targets = keys.targets(keys.odom_T_key, self.range_m)
        loops: list[Loop] = []
        between_parts: list[Loop] = []
        queries = self.queries(keys)
        for key in watch.track(queries, len(queries), "loops"):
            earlier = self.within_drift(keys, targets, key)
            loop = self._loop(keys, targets, key, earlier, usual_overlap)
            if loop and self._is_drift(keys, loop):
                loops.append(loop)
            others = keys.parts < keys.parts[key]
            if others.any():
                loop = self._loop(keys, targets, key, others, usual_overlap)
                if loop and loop.chance >= self.sure:
                    between_parts.append(loop)
        return loops + self._agreeing(keys, between_parts)

    def candidates(
        self, keys: Keys, targets: Targets, heights_m: NDArray[np.float32], rows: NDArray[np.int64]
    ) -> Answers:
        """The poses of the keys `rows` (m,) that look most like a Scan Context, nearest first."""
        distances, turned_deg = keys.spectra.compare(heights_m, rows)
        order = np.argsort(distances, kind="stable")[: self.nearest]
        world_T_anchor = targets.world_T_anchor[rows[order]]
        heading_deg = np.rad2deg(yaw(world_T_anchor)) + turned_deg[order]
        return Answers(world_T_anchor[:, :2, 3], (heading_deg + 180.0) % 360.0 - 180.0)

    def queries(self, keys: Keys) -> list[int]:
        """The keys that are asked for loops."""
        queried: list[int] = []
        for key, path_m in enumerate(keys.path_m.tolist()):
            if (
                not queried
                or keys.parts[key] != keys.parts[queried[-1]]
                or path_m - keys.path_m[queried[-1]] >= self.asked_m
            ):
                queried.append(key)
        return queried

    def _loop(
        self,
        keys: Keys,
        targets: Targets,
        key: int,
        allowed: NDArray[np.bool_],
        usual_overlap: float,
    ) -> Loop | None:
        """The loop of a key with one of the `allowed` (k,), None where nothing fits."""
        rows = np.flatnonzero(allowed)
        if not len(rows):
            return None
        answers = self.candidates(keys, targets, keys.heights_m[key], rows)
        fix = self.fixer.fix(keys.points_m(key), targets, answers, ~allowed)
        if not fix.hypotheses:
            return None
        overlap = self.overlap(keys, targets, key, fix.hypotheses[0])
        if overlap < self.least * usual_overlap:
            return None
        best = fix.hypotheses[0]
        alignment = best.alignment
        return Loop(
            best.row, key, alignment.target_T_source, alignment.covariance, overlap, fix.chance
        )

    def overlap(self, keys: Keys, targets: Targets, key: int, hypothesis: Hypothesis) -> float:
        """The share of what stands in a key that the submap of a hypothesis has."""
        registration = self.fixer.registration
        return share_standing(
            targets.cloud(registration, hypothesis.row),
            registration.prepare(keys.points_m(key)),
            hypothesis.alignment.target_T_source,
            registration.inlier_m,
        )

    def _is_drift(self, keys: Keys, loop: Loop) -> bool:
        """Whether odometry may have drifted as far as the loop says."""
        between_m = float(keys.path_m[loop.later] - keys.path_m[loop.key])
        by_loop = (keys.odom_T_key[loop.key] @ loop.key_T_later)[None]
        by_odometry = keys.odom_T_key[loop.later][None]
        return bool(self.drifted(by_loop, by_odometry, np.array([between_m]))[0])

    def drifted(self, a: Poses, b: Poses, between_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether odometry may have drifted from a to b (n, 4, 4) over so much path (n,)."""
        away_m, turn_deg = distance_and_turn(a, b)
        return np.asarray(
            (away_m < self.drift_m + self.drift * between_m)
            & (turn_deg < self.turn_deg + self.turn_deg_per_m * between_m)
        )

    def _agreeing(self, keys: Keys, loops: list[Loop]) -> list[Loop]:
        """The loops between two parts that enough others agree with.

        Each says where one part lies in the frame of the other; two agree where odometry along both
        parts allows it.
        """
        kept: list[Loop] = []
        pairs = [(int(keys.parts[loop.key]), int(keys.parts[loop.later])) for loop in loops]
        for parts in sorted(set(pairs)):
            of_parts = [loop for loop, pair in zip(loops, pairs, strict=True) if pair == parts]
            near = np.array([self._agree(keys, loop, of_parts) for loop in of_parts])
            best = near[near.sum(axis=1).argmax()]
            if best.sum() >= self.agreeing:
                kept += [loop for loop, is_near in zip(of_parts, best, strict=True) if is_near]
        return kept

    def _agree(self, keys: Keys, loop: Loop, others: list[Loop]) -> NDArray[np.bool_]:
        """Which other loops (n,) between the same parts say the same as a loop."""
        part_T_later_part = keys.odom_T_key[loop.key] @ (
            loop.key_T_later @ np.linalg.inv(keys.odom_T_key[loop.later])
        )
        later = np.array([other.later for other in others])
        key = np.array([other.key for other in others])
        part_T_later = keys.odom_T_key[key] @ np.stack([other.key_T_later for other in others])
        driven_m = np.abs(keys.path_m[later] - keys.path_m[loop.later]) + np.abs(
            keys.path_m[key] - keys.path_m[loop.key]
        )
        return self.drifted(part_T_later_part @ keys.odom_T_key[later], part_T_later, driven_m)
