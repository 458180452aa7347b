"""What is believed of the robot: forward Bayes over the ground of the map, headings, and "somewhere unseen" (METHODS 10)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift
from scipy.spatial import KDTree

CELL_M, HEADINGS = 4.0, 24
NEAR_MAP_M = 15.0
"""Ground farther from every training anchor is not the map's."""
LEAVES, ENTERS, JUMPS = 0.002, 0.002, 0.001
"""Chances a metre to leave the map and to enter it; a scan, to be carried anywhere."""
DRIFT = 0.05
"""Standard deviation of the odometry's step, as a share of it; of its turn too."""
REPEATS = 0.3
"""How often a wrong pose is followed by one that agrees with it: assumed, not learned."""
WITHIN = 1.5
"""Cells around a pose, each way, that are one with it."""


@dataclass
class Belief:
    """Chances over headings × cells, which with `unseen` add up to 1."""

    anchors_m: NDArray[np.float64]
    """(n, 2) of the map."""
    unseen_share: float = 0.2
    """Of queries to expect from places that the map does not have, as the verdict was learned with (METHODS 9.5)."""
    unseen: float = field(init=False)
    chances: NDArray[np.float64] = field(init=False)
    """(heading, row, column)."""

    def __post_init__(self) -> None:
        self._low_m = self.anchors_m.min(axis=0) - NEAR_MAP_M
        sides = np.ceil((np.ptp(self.anchors_m, axis=0) + 2 * NEAR_MAP_M) / CELL_M).astype(int)
        x_m, y_m = (self._low_m[axis] + (np.arange(sides[axis]) + 0.5) * CELL_M for axis in (0, 1))
        centres = np.stack(np.meshgrid(x_m, y_m), axis=-1)
        away_m = np.asarray(KDTree(self.anchors_m).query(centres.reshape(-1, 2))[0])
        self._on_map = away_m.reshape(centres.shape[:2]) < NEAR_MAP_M
        self._uniform = np.broadcast_to(self._on_map, (HEADINGS, *self._on_map.shape)) / (HEADINGS * self._on_map.sum())
        self.unseen = self.unseen_share
        self.chances = (1 - self.unseen) * self._uniform

    def move(self, step: NDArray[np.float64]) -> None:
        """After the robot moved by `step` (4, 4), its new pose in the old one's frame."""
        along, turn = step[:2, 3], float(np.arctan2(step[1, 0], step[0, 0]))
        length_m = float(np.linalg.norm(along))
        moved = np.empty_like(self.chances)
        for heading, plane in enumerate(self.chances):
            angle = 2 * np.pi * heading / HEADINGS + turn / 2
            east, north = (
                np.cos(angle) * along[0] - np.sin(angle) * along[1],
                np.sin(angle) * along[0] + np.cos(angle) * along[1],
            )
            moved[heading] = shift(plane, (north / CELL_M, east / CELL_M), order=1, prefilter=False)
        turned = turn * HEADINGS / (2 * np.pi)
        whole = int(np.floor(turned))
        share = turned - whole
        moved = (1 - share) * np.roll(moved, whole, axis=0) + share * np.roll(moved, whole + 1, axis=0)
        blur = DRIFT * length_m / CELL_M
        if blur > 0:
            moved = gaussian_filter(moved, (0.1 + DRIFT * abs(turned), blur, blur), mode=("wrap", "constant", "constant"))
        kept = moved * self._on_map * (1 - min(LEAVES * length_m, 1))
        unseen = self.unseen * (1 - min(ENTERS * length_m, 1))
        entered = (self.unseen - unseen) * self._uniform
        self.unseen = (1 - JUMPS) * (1 - float(kept.sum()) - float(entered.sum())) + JUMPS * self.unseen_share
        self.chances = (1 - JUMPS) * (kept + entered) + JUMPS * (1 - self.unseen_share) * self._uniform

    def see(self, world_T_robot: NDArray[np.float64], chance: float, tracked: bool = False) -> float:
        """A pose was measured that is right with this chance; returns the chance that it is right now, given all before.

        A wrong pose lies anywhere at first, so of a robot that may be anywhere the chance stays what it was. But wrong poses
        repeat themselves, as the next scan shows the same look-alike: REPEATS of them agree with what is believed. A `tracked`
        one was sought where it was believed: that it agrees says nothing, only its chance does, against that of a usual fix.
        """
        near = self._near(world_T_robot)
        usual = 1 - self.unseen_share
        everywhere, before = usual * float(self._uniform[near].sum()), self.at(world_T_robot)
        if not everywhere > 0 or not before > 0:
            return 0.0  # off the map
        repeated = usual / (1 - usual) if tracked else min(max(before, everywhere), REPEATS)
        right, wrong = before * chance, (1 - before) * (1 - chance) * repeated
        self.chances *= (1 - chance) * repeated
        self.unseen *= (1 - chance) * repeated
        self.chances[near] *= chance / ((1 - chance) * repeated)
        whole = right + wrong
        self.chances /= whole
        self.unseen /= whole
        return right / whole

    def at(self, world_T_robot: NDArray[np.float64]) -> float:
        """The chance that the robot is at this pose."""
        return float(self.chances[self._near(world_T_robot)].sum())

    def _near(self, world_T_robot: NDArray[np.float64]) -> tuple[NDArray[np.int64], slice, slice]:
        """The cells of a pose and around it."""
        x, y = (world_T_robot[:2, 3] - self._low_m) / CELL_M - 0.5
        heading = np.arctan2(world_T_robot[1, 0], world_T_robot[0, 0]) * HEADINGS / (2 * np.pi)
        turns = np.arange(np.ceil(heading - WITHIN), np.floor(heading + WITHIN) + 1).astype(int) % HEADINGS
        rows, columns = (slice(max(int(np.ceil(at - WITHIN)), 0), max(int(np.floor(at + WITHIN)) + 1, 0)) for at in (y, x))
        return turns, rows, columns
