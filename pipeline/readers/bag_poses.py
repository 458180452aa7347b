"""Reads the poses of bags: from a topic, or from a chain of transforms."""

from collections.abc import Sequence
from operator import itemgetter

from pipeline.errors import LogError
from pipeline.formats.bag import ODOMETRY, POSE, POSE_COVARIANCE
from pipeline.formats.bag_file import BagFile
from pipeline.formats.messages import frame_name, header, pose_numbers, poses
from pipeline.readers.bag_track import Track, message_stamps, trajectory
from pipeline.readers.bag_tree import Tree

KINDS = (ODOMETRY, POSE, POSE_COVARIANCE)


def track(files: Sequence[BagFile], name: str, max_gap_s: float) -> Track:
    """The poses of the topic or tf:PARENT>CHILD `name`, NaN where a message has no valid pose; raises LogError if none exist."""
    if name.startswith("tf:"):
        parent, _, child = name.removeprefix("tf:").partition(">")
        return Tree.read(files, moving=True).track(parent, child, max_gap_s)
    sent: list[tuple[int, int, tuple[float, ...]]] = []
    frames: set[str] = set()
    children: set[str] = set()
    broken = 0
    for file in files:
        kind = file.topics[name].kind if name in file.topics else ""
        for key, data in file.messages(name) if kind in KINDS else ():
            try:
                (stamp_ns, frame), message = header(data, file.ros), file.decode(data, kind)
            except LogError:
                broken += 1
                continue
            sent.append((key.received_ns, stamp_ns, pose_numbers(message, kind)))
            frames.add(frame)
            children.update([frame_name(message.child_frame_id)] if kind == ODOMETRY else [])
    for what, named in (("in", frames), ("of", children)):
        if len(named) > 1:
            raise LogError(f"{files[0].path}: {name} gives poses {what} several frames: {', '.join(sorted(named)):.80}")
    if not sent:
        raise LogError(f"{files[0].path}: {name} holds no pose that can be read")
    sent.sort(key=itemgetter(0))
    times, notes = message_stamps(name, [(stamp_ns, received_ns) for received_ns, stamp_ns, _ in sent])
    notes += (f"{name}: {broken:,} broken messages are left out",) if broken else ()
    found, left_out = trajectory(name, times, poses([numbers for _, _, numbers in sent]), max_gap_s)
    return Track(name, found, next(iter(children), "") or None, notes + left_out)
