"""Reads the poses of bags: from a topic, or from the tree of transforms in tf messages."""

from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, Stamps, Trajectory
from pipeline.formats.bag import ODOMETRY, POSE, POSE_COVARIANCE, TRANSFORMS
from pipeline.formats.bag_file import BagFile
from pipeline.formats.messages import (
    frame_name,
    gathered_variance,
    header,
    pose_numbers,
    poses,
    transform_numbers,
)
from pipeline.readers.log import LATEST_NS, Uncertainty

KINDS = (ODOMETRY, POSE, POSE_COVARIANCE)
STILL = 1e-6
"""A transform whose entries (metres, rotation matrix) never change by more than this is fixed."""


@dataclass(frozen=True)
class Track:
    """The poses of a body over time from a bag."""

    name: str
    """The topic, or tf:PARENT>CHILD."""
    trajectory: Trajectory
    parent: str | None
    """The frame of the world; None where the messages do not name it."""
    child: str | None
    """The frame of the body; None where the messages do not name it."""
    notes: tuple[str, ...]
    uncertainty: Uncertainty | None = None
    """Of the poses; None of transforms, which have none."""


def track(files: Sequence[BagFile], name: str, max_gap_s: float) -> Track:
    """The poses of the topic or tf:PARENT>CHILD `name`, NaN where a message has no valid pose.

    Raises LogError if none exist.
    """
    if name.startswith("tf:"):
        parent, _, child = name.removeprefix("tf:").partition(">")
        return Tree.read(files, moving=True).track(parent, child, max_gap_s)
    messages: list[tuple[int, int, tuple[float, ...], tuple[float, float]]] = []
    frames: set[str] = set()
    children: set[str] = set()
    broken = 0
    for file in files:
        kind = file.topics[name].kind if name in file.topics else ""
        for key, data in file.messages(name) if kind in KINDS else ():
            try:
                (stamp_ns, frame) = header(data, file.ros)
                message = file.decode(data, kind)
            except LogError:
                broken += 1
                continue
            messages.append(
                (
                    key.received_ns,
                    stamp_ns,
                    pose_numbers(message, kind),
                    gathered_variance(message, kind),
                )
            )
            frames.add(frame)
            children.update([frame_name(message.child_frame_id)] if kind == ODOMETRY else [])
    for preposition, frame_names in (("in", frames), ("of", children)):
        if len(frame_names) > 1:
            raise LogError(
                f"{files[0].path}: {name} gives poses {preposition} several frames: "
                f"{', '.join(sorted(frame_names)):.80}"
            )
    if not messages:
        raise LogError(f"{files[0].path}: {name} holds no pose that can be read")
    messages.sort(key=itemgetter(0))
    times, notes = message_stamps(
        name, [(stamp_ns, received_ns) for received_ns, stamp_ns, *_ in messages]
    )
    notes += (f"{name}: {broken:,} broken messages are left out",) if broken else ()
    topic_trajectory, left_out = trajectory(
        name, times, poses([numbers for _, _, numbers, _ in messages]), max_gap_s
    )
    rows = longest_increasing(times)
    variances = np.array([variance for *_, variance in messages], np.float64)[rows]
    return Track(
        name,
        topic_trajectory,
        next(iter(frames), "") or None,
        next(iter(children), "") or None,
        notes + left_out,
        Uncertainty(times[rows], variances),
    )


@dataclass(frozen=True)
class Tree:
    """The transforms of tf messages: for each pair of frames (parent, child), stamps and poses."""

    where: str
    edges: dict[tuple[str, str], tuple[Stamps, Poses]]
    broken: int
    """Messages that could not be read."""

    @staticmethod
    def read(files: Sequence[BagFile], moving: bool) -> "Tree":
        """Read the transforms of the topics that end in tf_static; with `moving`, of all topics."""
        numbers_by_edge: dict[tuple[str, str], list[tuple[int, int, tuple[float, ...]]]] = (
            defaultdict(list)
        )
        broken = 0
        topics = (
            (file, name)
            for file in files
            for name, topic in file.topics.items()
            if topic.kind == TRANSFORMS
        )
        for file, name in (
            (file, name) for file, name in topics if moving or name.endswith("tf_static")
        ):
            for key, data in file.messages(name):
                try:
                    message = file.decode(data, TRANSFORMS)
                except LogError:
                    broken += 1
                    continue
                for stamped in message.transforms:
                    stamp = stamped.header.stamp
                    edge = (frame_name(stamped.header.frame_id), frame_name(stamped.child_frame_id))
                    stamp_ns = stamp.sec * 10**9 + stamp.nanosec
                    numbers_by_edge[edge].append(
                        (key.received_ns, stamp_ns, transform_numbers(stamped))
                    )
        edges: dict[tuple[str, str], tuple[Stamps, Poses]] = {}
        for edge, rows in numbers_by_edge.items():
            rows.sort(key=itemgetter(0))
            parent_T_child = poses([numbers for _, _, numbers in rows])
            has_pose = np.isfinite(parent_T_child[:, 0, 0])
            if has_pose.any():
                edges[edge] = (
                    np.array([stamp_ns for _, stamp_ns, _ in rows], np.int64)[has_pose],
                    parent_T_child[has_pose],
                )
        return Tree(str(files[0].path), edges, broken)

    def fixed(self, a: str, b: str) -> NDArray[np.float64] | None:
        """a_T_b (4, 4) by a chain of fixed transforms; None where there is none."""
        way = self._way(
            {edge for edge, (_, edge_poses) in self.edges.items() if _still(edge_poses)}, a, b
        )
        if way is None:
            return None
        a_T_b = np.eye(4)
        for edge, forward in way:
            step = self.edges[edge][1][-1]
            a_T_b = a_T_b @ (step if forward else np.linalg.inv(step))
        return a_T_b

    def moves(self, a: str, b: str) -> bool:
        """Whether transforms lead from a to b, and at least one of them changes over time."""
        way = self._way(set(self.edges), a, b)
        return any(not _still(self.edges[edge][1]) for edge, _ in way or ())

    def track(self, parent: str, child: str, max_gap_s: float) -> Track:
        """parent_T_child at the stamps of the most frequent moving transform of the chain.

        The other transforms are interpolated. Raises LogError where no transforms lead from parent
        to child, or none of them moves.
        """
        name = f"tf:{parent}>{child}"
        way = self._way(set(self.edges), parent, child)
        if way is None:
            edge_names = ", ".join(f"{a}>{b}" for a, b in sorted(self.edges)) or "none"
            raise LogError(
                f"{self.where}: no transforms lead from {parent} to {child}; those that it holds: "
                f"{edge_names:.400}"
            )
        moving = [edge for edge, _ in way if not _still(self.edges[edge][1])]
        if not moving:
            raise LogError(
                f"{self.where}: {name} never changes, so it is no path; name the frame that the "
                "vehicle moves in"
            )
        notes: tuple[str, ...] = (
            (f"{name}: {self.broken:,} broken messages of transforms are left out",)
            if self.broken
            else ()
        )
        trajectories = {}
        for edge in moving:
            trajectories[edge], left_out = trajectory(">".join(edge), *self.edges[edge], max_gap_s)
            notes += left_out
        stamps_ns = max((trajectory.stamps_ns for trajectory in trajectories.values()), key=len)
        parent_T_child = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
        for edge, forward in way:
            steps = (
                trajectories[edge].at(stamps_ns)[0]
                if edge in trajectories
                else self.edges[edge][1][-1:]
            )
            parent_T_child = parent_T_child @ (steps if forward else np.linalg.inv(steps))
        return Track(name, Trajectory(stamps_ns, parent_T_child, max_gap_s), parent, child, notes)

    @staticmethod
    def _way(
        edges: set[tuple[str, str]], a: str, b: str
    ) -> list[tuple[tuple[str, str], bool]] | None:
        """The shortest chain from a to b: its edges, and whether each leads from parent to child.

        None where there is none.
        """
        ways: dict[str, list[tuple[tuple[str, str], bool]]] = {a: []}
        queue = deque([a])
        while queue and b not in ways:
            frame = queue.popleft()
            for edge in sorted(edges):
                if frame in edge:
                    forward = edge[0] == frame
                    neighbour = edge[forward]
                    if neighbour not in ways:
                        ways[neighbour] = [*ways[frame], (edge, forward)]
                        queue.append(neighbour)
        return ways.get(b)


def _still(edge_poses: Poses) -> bool:
    """Whether a transform (n, 4, 4) never changes by more than STILL."""
    return bool((np.abs(edge_poses - edge_poses[-1]) <= STILL).all())


def message_stamps(name: str, stamps: Sequence[tuple[int, int]]) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps (n,) in ns from pairs of header stamp and time of receipt.

    The times of receipt, with a note, are taken if all header stamps are 0.
    """
    pairs_ns = np.array(
        [(stamp, min(max(received, 0), LATEST_NS)) for stamp, received in stamps], np.int64
    ).reshape(-1, 2)
    if len(pairs_ns) and not pairs_ns[:, 0].any():
        return pairs_ns[:, 1], (f"{name}: no message is stamped; the times of receipt are used",)
    return pairs_ns[:, 0], ()


def longest_increasing(stamps_ns: Stamps) -> NDArray[np.int64]:
    """Rows of a longest subsequence of strictly increasing stamps: the fewest rows are dropped."""
    ends: list[int] = []
    rows: list[int] = []
    before = np.full(len(stamps_ns), -1)
    for row, stamp in enumerate(stamps_ns.tolist()):
        length = bisect_left(ends, stamp)
        before[row] = rows[length - 1] if length else -1
        ends[length : length + 1] = [stamp]
        rows[length : length + 1] = [row]
    chain = rows[-1:]
    while chain and before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1], np.int64)


def trajectory(
    name: str, times: Stamps, world_T_body: Poses, max_gap_s: float
) -> tuple[Trajectory, tuple[str, ...]]:
    """Poses (n, 4, 4) as a trajectory, and notes on the poses that are left out."""
    rows = longest_increasing(times)
    unposed = int(np.isnan(world_T_body[rows, 0, 0]).sum())
    counts = {
        "poses are left out, their stamps repeat or run backwards": len(times) - len(rows),
        "poses hold no place or no rotation: gaps": unposed,
    }
    notes = tuple(
        f"{name}: {count:,} of {len(times):,} {reason}" for reason, count in counts.items() if count
    )
    return Trajectory(times[rows], world_T_body[rows], max_gap_s), notes
