"""Loops: pairs of keys at which a drive comes back to a place; they reveal its drift.

In: the keys of a drive (keys.py). Out: its loops, which become factors of the graph (METHODS 12.2).
For one key in every 4 m of path:

1. Take the earlier keys that may be near it within the drift of odometry. All other loops are
   wrong, however well they fit, and no later step would reject them.
2. Among these, take the five keys most similar by Scan Context (Kim and Kim, IROS 2018). The
   networks are not used, since they are evaluated on the resulting map.
3. Register the key with these, and with others of similar walls, by the search of
   posing/search.py.
4. Accept the likeliest pose if the two keys overlap, and if odometry may have drifted this far.

Between two parts of a drive, which odometry does not join, step 1 and the check of the drift are
impossible: there a loop is accepted only if enough other loops agree with it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn, yaw
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, Share, checked
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.slam.keys import Keys, spaced
from pipeline.slam.odometry import share_standing
from pipeline.views.scan_context import ScanContext

NEAR_M = 8.0
"""Largest distance at which a scan can be registered with a key."""
Candidate = TypeVar("Candidate")


@dataclass(frozen=True)
class Loop:
    """Two keys at the same place."""

    key: int
    """The earlier key, or a key of a map."""
    later: int
    """The later key."""
    key_T_later: Poses
    """(4, 4) pose of the later key in the earlier key's frame."""
    covariance: NDArray[np.float64]
    """(6, 6) of a small turn in radians, then a step in metres, in the later key's frame."""
    probability: float
    """The probability that the pose is right, by the search's model (posing/probabilities.py)."""


@dataclass(frozen=True)
@checked("loops")
class LoopSearch:
    """Finds the loops of a drive (conf/slam.yaml)."""

    view: ScanContext = field(default_factory=ScanContext)
    """Draws the view by which candidates are chosen."""
    fixer: Fixer = field(default_factory=Fixer)
    """Registers a key with candidates."""
    every_m: Positive = 2.0
    """Path from one key to the next."""
    asked_m: Positive = 4.0
    """Path from one key that is searched for loops to the next."""
    back_m: Positive = 50.0
    """Least path between the two keys of a loop."""
    nearest: Count = 5
    """Number of candidates by Scan Context that a key is registered with."""
    drift_m: NotNegative = 2.0
    drift: NotNegative = 0.06
    """Largest drift of odometry between two keys: `drift_m`, plus this share of the path."""
    turn_deg: NotNegative = 5.0
    turn_deg_per_m: NotNegative = 0.3
    """Largest drift of the heading: `turn_deg`, plus `turn_deg_per_m` times the path."""
    least: Share = 0.5
    """Least overlap of the two keys of a loop, as a share of the drive's usual overlap."""
    agreeing: Count = 3
    """Least number of agreeing loops that join two parts of a drive."""
    sure: Share = 0.95
    """Least probability of a loop between two parts, and of a fix on a map."""
    range_m: Positive = 100.0
    """Points farther from a key are left out."""

    def within(self, keys: Keys, usual_overlap: float, watch: Progress) -> list[Loop]:
        """The loops of a drive, within its parts and between them.

        `usual_overlap` is the median overlap of neighbouring scans (`Track.usual_overlap`).
        """
        targets = keys.targets(keys.odom_T_key, self.range_m)
        loops: list[Loop] = []
        between_parts: list[Loop] = []
        queries = self.queries(keys)
        for key in watch.track(queries, len(queries), "loops"):
            within_reach = self.within_drift(keys, targets, key)
            loop = self.loop(keys, key, keys, targets, within_reach, usual_overlap)
            if loop and self._is_drift(keys, loop):
                loops.append(loop)
            earlier_parts = keys.parts < keys.parts[key]
            if earlier_parts.any():
                loop = self.loop(keys, key, keys, targets, earlier_parts, usual_overlap)
                if loop and loop.probability >= self.sure:
                    between_parts.append(loop)
        # of the loops between two parts, keep those that agree with enough others
        return loops + agreeing(
            between_parts,
            lambda loop: (int(keys.parts[loop.key]), int(keys.parts[loop.later])),
            lambda loop, others: self._agreeing_with(keys, loop, others),
            self.agreeing,
        )

    def queries(self, keys: Keys) -> list[int]:
        """The keys to search for loops: the first of each part, then one every `asked_m`."""
        return spaced(keys.parts, keys.path_m, self.asked_m)

    def within_drift(self, keys: Keys, targets: Targets, key: int) -> NDArray[np.bool_]:
        """Which earlier keys (k,) of the same part may be near a key, by odometry."""
        between_m = keys.path_m[key] - keys.path_m
        away_m = np.linalg.norm(
            targets.world_T_anchor[:, :2, 3] - targets.world_T_anchor[key, :2, 3], axis=1
        )
        near = away_m < self.drift_m + self.drift * between_m + NEAR_M
        return np.asarray(near & (between_m > self.back_m) & (keys.parts == keys.parts[key]))

    def loop(
        self,
        keys: Keys,
        key: int,
        among: Keys,
        targets: Targets,
        allowed: NDArray[np.bool_],
        usual_overlap: float,
    ) -> Loop | None:
        """The likeliest loop of a key with one of the `allowed` keys (k,) of a drive or a map.

        Scan Context chooses candidates `among` these keys, and the search registers the key with
        them; `targets` are the same keys at their poses. Returns None if no pose is found, or if
        the two keys overlap too little.
        """
        rows = np.flatnonzero(allowed)
        if not len(rows):
            return None
        distances, turned_deg = among.spectra.compare(keys.heights_m[key], rows)
        order = np.argsort(distances, kind="stable")[: self.nearest]  # most similar first
        world_T_anchor = targets.world_T_anchor[rows[order]]
        heading_deg = np.rad2deg(yaw(world_T_anchor)) + turned_deg[order]
        within_turn_deg = (heading_deg + 180.0) % 360.0 - 180.0  # from −180 to 180
        answers = Answers(world_T_anchor[:, :2, 3], within_turn_deg)
        points_m = keys.points_m(key)
        fix = self.fixer.fix(points_m, targets, answers, ~allowed)
        if not fix.hypotheses:
            return None
        best = fix.hypotheses[0]
        registration = self.fixer.registration
        key_T_later = best.alignment.target_T_source
        overlap = share_standing(
            targets.cloud(registration, best.row),
            registration.prepare(points_m),
            key_T_later,
            registration.inlier_m,
        )
        if overlap < self.least * usual_overlap:
            return None
        return Loop(best.row, key, key_T_later, best.alignment.covariance, fix.probability)

    def _is_drift(self, keys: Keys, loop: Loop) -> bool:
        """Whether odometry may have drifted as far as a loop implies."""
        by_loop = keys.odom_T_key[loop.key] @ loop.key_T_later
        between_m = keys.path_m[loop.later] - keys.path_m[loop.key]
        return bool(self.drifted(by_loop, keys.odom_T_key[loop.later], between_m))

    def drifted(
        self, by_odometry: Poses, true: Poses, between_m: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Whether (n,) odometry may have drifted from the true poses (n, 4, 4) to its own poses.

        `between_m` (n,) is the length of path in between.
        """
        away_m, turn_deg = distance_and_turn(by_odometry, true)
        return np.asarray(
            (away_m < self.drift_m + self.drift * between_m)
            & (turn_deg < self.turn_deg + self.turn_deg_per_m * between_m)
        )

    def _agreeing_with(self, keys: Keys, loop: Loop, loops: list[Loop]) -> NDArray[np.bool_]:
        """Which loops (n,) between the same two parts agree with `loop`, within the drift."""
        earlier_T_part = keys.odom_T_key[loop.key] @ (
            loop.key_T_later @ np.linalg.inv(keys.odom_T_key[loop.later])
        )
        key = np.array([other.key for other in loops])
        later = np.array([other.later for other in loops])
        earlier_T_later = keys.odom_T_key[key] @ np.stack([other.key_T_later for other in loops])
        # the path between the two loops along the later part, and along the earlier one
        driven_m = np.abs(keys.path_m[later] - keys.path_m[loop.later]) + np.abs(
            keys.path_m[key] - keys.path_m[loop.key]
        )
        return self.drifted(earlier_T_part @ keys.odom_T_key[later], earlier_T_later, driven_m)


def agreeing(
    candidates: Sequence[Candidate],
    group: Callable[[Candidate], tuple[int, ...]],
    agrees: Callable[[Candidate, list[Candidate]], NDArray[np.bool_]],
    fewest: int,
) -> list[Candidate]:
    """Of each group of loops or fixes, the largest set that agrees with one of its members.

    `group` returns the group of a candidate, and `agrees` which candidates of its group (n,) agree
    with it. Sets of fewer than `fewest` are left out.
    """
    groups: dict[tuple[int, ...], list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(group(candidate), []).append(candidate)
    agreed: list[Candidate] = []
    for _, members in sorted(groups.items(), key=lambda item: item[0]):
        largest = max((np.flatnonzero(agrees(member, members)) for member in members), key=len)
        if len(largest) >= fewest:
            agreed += [members[number] for number in largest]
    return agreed
