"""Finds where a lidar sits on its vehicle, by the transforms of bags.

Transforms in, a pose out. Readers, `yearloc slam`, `localize`, `watch`, `update`, `--follow` and
`inspect` all decide it here, and each says in its own words what to do where it is unknown.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain

from pipeline.core.frames import Poses
from pipeline.formats.bag_file import BagFile
from pipeline.readers.bag_poses import Tree

BODIES = ("base_footprint", "base_link", "body", "imu", "imu_link")
"""Frames that may stand for the vehicle, the likeliest first."""


@dataclass(frozen=True)
class Transforms:
    """The transforms of bags: a fixed one is on tf_static, or else repeated on tf."""

    static: Tree
    """Those on tf_static."""
    read_all: Callable[[], Tree]
    """Reads all, which may be many."""

    @classmethod
    def read(cls, files: Sequence[BagFile]) -> "Transforms":
        """The transforms of bags; those on tf are read only when they are needed."""
        return cls(Tree.read(files, moving=False), cache(partial(Tree.read, files, moving=True)))

    def fixed(self, *ends: tuple[str, str]) -> Poses | None:
        """a_T_b (4, 4) for the first pair (a, b) of frames between which fixed transforms lead.

        None where they lead between none of them.
        """
        poses = (self.static.fixed(a, b) for a, b in ends)
        repeated_poses = (self.read_all().fixed(a, b) for a, b in ends)
        return next((pose for pose in chain(poses, repeated_poses) if pose is not None), None)

    def body_T_lidar(self, bodies: Sequence[str], lidar_frames: set[str]) -> Poses | None:
        """The pose (4, 4) of the lidar in the first of the frames `bodies` that leads to it.

        `lidar_frames` are the frames of its clouds. None where no fixed transforms lead to the
        lidar, or the clouds are of several.
        """
        if len(lidar_frames) != 1:
            return None
        (lidar_frame,) = lidar_frames
        return self.fixed(*((body, lidar_frame) for body in bodies))

    def vehicle(self) -> str | None:
        """The likeliest frame of the vehicle that any transform names; None where there is none."""
        frames = {frame for edge in self.read_all().edges for frame in edge}
        return next((body for body in BODIES if body in frames), None)
