"""Reads the poses of a vehicle from bags: bags and a source's name in, a Track of poses out.

A source is a topic with poses (Odometry, PoseStamped, PoseWithCovarianceStamped), or
tf:PARENT>CHILD: then the transforms in the tf messages, each between two neighbouring frames, are
chained from the frame PARENT to the frame CHILD.
"""

from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import LATEST_NS, Poses, Stamps, Trajectory
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
from pipeline.readers.log import Uncertainty

KINDS = (ODOMETRY, POSE, POSE_COVARIANCE)
"""The types of messages that hold a pose."""
MAX_FIXED_CHANGE = 1e-6
"""A transform whose entries (metres, rotation matrix) never change by more than this is fixed."""

Edge = tuple[str, str]
"""The frames (parent, child) of a transform."""


@dataclass(frozen=True)
class Track:
    """The poses of a body over time, from one source in the bags."""

    name: str
    """The source: the topic, or tf:PARENT>CHILD."""
    trajectory: Trajectory
    """The poses parent_T_child at their stamps."""
    parent: str | None
    """The frame in which the poses are given, for instance map or odom; None where the messages do
    not name it."""
    child: str | None
    """The frame of the body, for instance base_link; None where the messages do not name it."""
    notes: tuple[str, ...]
    """Lines for the user."""
    uncertainty: Uncertainty | None = None
    """The variance that the messages give for the poses; None for transforms, which give none."""


def read_track(files: Sequence[BagFile], name: str, max_gap_s: float) -> Track:
    """Read the poses of the source `name`; NaN where a message has no valid pose.

    Poses further apart than `max_gap_s` are a gap. Raises LogError if the bags hold no such pose,
    or poses in several frames.
    """
    if name.startswith("tf:"):
        parent, _, child = name.removeprefix("tf:").partition(">")
        return Tree.read(files, moving=True).make_track(parent, child, max_gap_s)
    where = files[0].path
    messages, broken_count = read_messages(files, name, KINDS, pose_of)
    frames = {message.frame for message in messages}
    contents = [message.content for message in messages]
    children = {child for child, _, _ in contents if child is not None}
    if len(frames) > 1:
        raise LogError(
            f"{where}: {name} gives poses in several frames: {', '.join(sorted(frames)):.80}"
        )
    if len(children) > 1:
        raise LogError(
            f"{where}: {name} gives poses of several frames: {', '.join(sorted(children)):.80}"
        )
    if not messages:
        raise LogError(f"{where}: {name} holds no pose that can be read")
    stamps_ns, notes = message_stamps(
        name, [(message.stamp_ns, message.received_ns) for message in messages]
    )
    if broken_count:
        notes += (f"{name}: {broken_count:,} broken messages are left out",)
    parent_T_child = poses([numbers for _, numbers, _ in contents])
    trajectory, pose_notes = make_trajectory(name, stamps_ns, parent_T_child, max_gap_s)
    # The variances of the rows that the trajectory keeps.
    rows = longest_increasing(stamps_ns)
    variances = np.array([variance for _, _, variance in contents], np.float64)[rows]
    return Track(
        name=name,
        trajectory=trajectory,
        parent=next(iter(frames), "") or None,
        child=next(iter(children), "") or None,
        notes=notes + pose_notes,
        uncertainty=Uncertainty(stamps_ns[rows], variances),
    )


class Message(NamedTuple):
    """A message that begins with a header, with the part of its content that is used."""

    received_ns: int
    """The time of receipt."""
    stamp_ns: int
    """The stamp in the header."""
    frame: str
    """The frame in the header."""
    content: Any
    """What a reader picked from the message."""


def read_messages(
    files: Sequence[BagFile], topic: str, kinds: Sequence[str], take: Callable[[Any, str], Any]
) -> tuple[list[Message], int]:
    """The messages of a topic, in order of receipt, and how many more are broken.

    `take` picks the content from a message and its type, which is one of `kinds`.
    """
    messages: list[Message] = []
    broken_count = 0
    for file in files:
        kind = file.topics[topic].kind if topic in file.topics else ""
        if kind not in kinds:
            continue
        for key, data in file.messages(topic):
            try:
                stamp_ns, frame = header(data, file.ros)
                content = take(file.decode(data, kind), kind)
            except LogError:
                broken_count += 1
            else:
                messages.append(Message(key.received_ns, stamp_ns, frame, content))
    messages.sort(key=attrgetter("received_ns"))
    return messages, broken_count


def pose_of(message: Any, kind: str) -> tuple[str | None, tuple[float, ...], tuple[float, float]]:
    """The body's frame, position and quaternion, and variance, from a message of type `kind`.

    The frame is None if the message does not name it. Position (m) and quaternion (x, y, z, w) are
    seven numbers. The variance is (position in m², heading in rad²); NaN if the message gives none.
    """
    child = frame_name(message.child_frame_id) if kind == ODOMETRY else None
    return child, pose_numbers(message, kind), gathered_variance(message, kind)


def transform_of(stamped: Any) -> tuple[Edge, int, tuple[float, ...]]:
    """The frames of a TransformStamped; its stamp in ns; its translation (m) and quaternion."""
    stamp = stamped.header.stamp
    edge = (frame_name(stamped.header.frame_id), frame_name(stamped.child_frame_id))
    return edge, stamp.sec * 10**9 + stamp.nanosec, transform_numbers(stamped)


class _Link(NamedTuple):
    """One transform in a chain of transforms."""

    edge: Edge
    is_forward: bool
    """Whether the chain passes the transform from parent to child; else from child to parent."""


@dataclass(frozen=True)
class Tree:
    """The transforms of tf messages, which form a tree of frames."""

    where: str
    """The path of the first bag, for errors."""
    edges: dict[Edge, tuple[Stamps, Poses]]
    """For each pair of frames the stamps (n,) and parent_T_child (n, 4, 4), in order of receipt."""
    broken_count: int
    """The number of messages that could not be read."""

    @staticmethod
    def read(files: Sequence[BagFile], moving: bool) -> "Tree":
        """Read the transforms of all topics; without `moving`, of those that end in tf_static."""
        messages_by_edge: dict[Edge, list[Message]] = defaultdict(list)
        broken_count = 0
        topics = [
            (file, name)
            for file in files
            for name, topic in file.topics.items()
            if topic.kind == TRANSFORMS and (moving or name.endswith("tf_static"))
        ]
        for file, topic in topics:
            for key, data in file.messages(topic):
                try:
                    transforms = file.decode(data, TRANSFORMS).transforms
                except LogError:
                    broken_count += 1
                    continue
                for stamped in transforms:
                    edge, stamp_ns, numbers = transform_of(stamped)
                    message = Message(key.received_ns, stamp_ns, edge[0], numbers)
                    messages_by_edge[edge].append(message)
        edges: dict[Edge, tuple[Stamps, Poses]] = {}
        for edge, edge_messages in messages_by_edge.items():
            edge_messages.sort(key=attrgetter("received_ns"))
            stamps_ns = np.array([message.stamp_ns for message in edge_messages], np.int64)
            parent_T_child = poses([message.content for message in edge_messages])
            has_pose = np.isfinite(parent_T_child[:, 0, 0])
            if has_pose.any():
                edges[edge] = (stamps_ns[has_pose], parent_T_child[has_pose])
        return Tree(str(files[0].path), edges, broken_count)

    def fixed(self, a: str, b: str) -> NDArray[np.float64] | None:
        """a_T_b (4, 4) by a chain of fixed transforms; None where there is none."""
        chain = _chain({edge for edge in self.edges if self._is_fixed(edge)}, a, b)
        if chain is None:
            return None
        a_T_b = np.eye(4)
        for edge, is_forward in chain:
            parent_T_child = self._poses(edge)[-1]
            step = parent_T_child if is_forward else np.linalg.inv(parent_T_child)
            a_T_b = a_T_b @ step
        return a_T_b

    def moves(self, a: str, b: str) -> bool:
        """Whether transforms lead from a to b, and at least one of them changes over time."""
        chain = _chain(self.edges, a, b) or []
        return any(not self._is_fixed(link.edge) for link in chain)

    def make_track(self, parent: str, child: str, max_gap_s: float) -> Track:
        """parent_T_child at the stamps of the most frequent moving transform of the chain.

        The other transforms are interpolated, but not over more than `max_gap_s`. Raises LogError
        where no transforms lead from parent to child, or none of them moves.
        """
        name = f"tf:{parent}>{child}"
        chain = _chain(self.edges, parent, child)
        if chain is None:
            edge_names = ", ".join(f"{a}>{b}" for a, b in sorted(self.edges)) or "none"
            raise LogError(
                f"{self.where}: no transforms lead from {parent} to {child}; those that it holds: "
                f"{edge_names:.400}"
            )
        moving_edges = [link.edge for link in chain if not self._is_fixed(link.edge)]
        if not moving_edges:
            raise LogError(
                f"{self.where}: {name} never changes, so it is no path; name the frame that the "
                "vehicle moves in"
            )
        notes: tuple[str, ...] = ()
        if self.broken_count:
            notes += (f"{name}: {self.broken_count:,} broken messages of transforms are left out",)
        trajectories: dict[Edge, Trajectory] = {}
        for edge in moving_edges:
            edge_name = ">".join(edge)
            trajectories[edge], pose_notes = make_trajectory(
                edge_name, *self.edges[edge], max_gap_s
            )
            notes += pose_notes
        stamps_ns = max((trajectory.stamps_ns for trajectory in trajectories.values()), key=len)
        parent_T_child = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
        for edge, is_forward in chain:
            if edge in trajectories:
                edge_poses, _ = trajectories[edge].at(stamps_ns)
            else:
                edge_poses = self._poses(edge)[-1:]  # one pose for all stamps
            steps = edge_poses if is_forward else np.linalg.inv(edge_poses)
            parent_T_child = parent_T_child @ steps
        return Track(name, Trajectory(stamps_ns, parent_T_child, max_gap_s), parent, child, notes)

    def _poses(self, edge: Edge) -> Poses:
        """The poses (n, 4, 4) of a transform, in order of receipt."""
        _, parent_T_child = self.edges[edge]
        return parent_T_child

    def _is_fixed(self, edge: Edge) -> bool:
        """Whether a transform never changes by more than MAX_FIXED_CHANGE."""
        edge_poses = self._poses(edge)
        return bool((np.abs(edge_poses - edge_poses[-1]) <= MAX_FIXED_CHANGE).all())


def _chain(edges: Iterable[Edge], a: str, b: str) -> list[_Link] | None:
    """The shortest chain of transforms from frame a to b, by breadth-first search, or None."""
    edges = sorted(edges)
    chains: dict[str, list[_Link]] = {a: []}
    queue = deque([a])
    while queue and b not in chains:
        frame = queue.popleft()
        for parent, child in edges:
            if frame not in (parent, child):
                continue
            is_forward = frame == parent
            neighbour = child if is_forward else parent
            if neighbour not in chains:
                chains[neighbour] = [*chains[frame], _Link((parent, child), is_forward)]
                queue.append(neighbour)
    return chains.get(b)


def message_stamps(name: str, stamps: Sequence[tuple[int, int]]) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps (n,) in ns of the messages of topic `name`, and notes for the user.

    `stamps` are pairs of the stamp in the header and the time of receipt, in ns. The times of
    receipt are taken, with a note, if all header stamps are 0.
    """
    header_ns = np.array([stamp_ns for stamp_ns, _ in stamps], np.int64)
    if not len(stamps) or header_ns.any():
        return header_ns, ()
    received_ns = [min(max(received_ns, 0), LATEST_NS) for _, received_ns in stamps]
    note = f"{name}: no message is stamped; the times of receipt are used"
    return np.array(received_ns, np.int64), (note,)


def longest_increasing(stamps_ns: Stamps) -> NDArray[np.int64]:
    """Rows (k,) of a longest subsequence of strictly increasing stamps (n,).

    So the fewest messages are dropped. The algorithm is patience sorting: `ends` holds for each
    length the smallest stamp that a subsequence of this length can end in.
    """
    ends: list[int] = []
    end_rows: list[int] = []
    previous_row = np.full(len(stamps_ns), -1)
    for row, stamp in enumerate(stamps_ns.tolist()):
        # The length of the longest subsequence that ends before this stamp.
        length = bisect_left(ends, stamp)
        previous_row[row] = end_rows[length - 1] if length else -1
        # Replace the end of the subsequences of length + 1, or append the first one.
        ends[length : length + 1] = [stamp]
        end_rows[length : length + 1] = [row]
    # Follow the longest subsequence from its end back to its start.
    rows = end_rows[-1:]
    while rows and previous_row[rows[-1]] >= 0:
        rows.append(int(previous_row[rows[-1]]))
    return np.array(rows[::-1], np.int64)


def make_trajectory(
    name: str, stamps_ns: Stamps, parent_T_child: Poses, max_gap_s: float
) -> tuple[Trajectory, tuple[str, ...]]:
    """Poses (n, 4, 4) at stamps (n,) as a trajectory, and notes on the poses that are left out."""
    rows = longest_increasing(stamps_ns)
    unposed_count = int(np.isnan(parent_T_child[rows, 0, 0]).sum())
    counts = {
        "poses are left out, their stamps repeat or run backwards": len(stamps_ns) - len(rows),
        "poses hold no place or no rotation: gaps": unposed_count,
    }
    notes = tuple(
        f"{name}: {count:,} of {len(stamps_ns):,} {reason}"
        for reason, count in counts.items()
        if count
    )
    return Trajectory(stamps_ns[rows], parent_T_child[rows], max_gap_s), notes
