"""The poses of a body in a bag as a trajectory, although stamps may repeat, run backwards or be missing."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, Stamps, Trajectory
from pipeline.readers.log import LATEST_NS


@dataclass(frozen=True)
class Track:
    """The poses of a body over time from a bag."""

    name: str
    """The topic, or tf:PARENT>CHILD."""
    trajectory: Trajectory
    child: str | None
    """The frame of the body; None where the messages do not name it."""
    notes: tuple[str, ...]


def message_stamps(name: str, stamps: Sequence[tuple[int, int]]) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps (n,) in ns from pairs of header stamp and time of receipt; the latter, with a note, if all header stamps are 0."""
    both = np.array([(stamp, min(max(received, 0), LATEST_NS)) for stamp, received in stamps], np.int64).reshape(-1, 2)
    if len(both) and not both[:, 0].any():
        return both[:, 1], (f"{name}: no message is stamped; the times of receipt are used",)
    return both[:, 0], ()


def longest_increasing(stamps_ns: Stamps) -> NDArray[np.int64]:
    """Rows of a longest subsequence of strictly increasing stamps, so that the fewest rows are dropped."""
    ends: list[int] = []
    rows: list[int] = []
    before = np.full(len(stamps_ns), -1)
    for row, stamp in enumerate(stamps_ns.tolist()):
        at = bisect_left(ends, stamp)
        before[row] = rows[at - 1] if at else -1
        ends[at : at + 1], rows[at : at + 1] = [stamp], [row]
    chain = rows[-1:]
    while chain and before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1], np.int64)


def trajectory(name: str, times: Stamps, world_T_body: Poses, max_gap_s: float) -> tuple[Trajectory, tuple[str, ...]]:
    """Poses (n, 4, 4) as a trajectory, and notes on the poses that are left out."""
    rows = longest_increasing(times)
    empty = int(np.isnan(world_T_body[rows, 0, 0]).sum())
    counts = {
        "poses are left out, their stamps repeat or run backwards": len(times) - len(rows),
        "poses hold no place or no rotation: gaps": empty,
    }
    notes = tuple(f"{name}: {count:,} of {len(times):,} {what}" for what, count in counts.items() if count)
    return Trajectory(times[rows], world_T_body[rows], max_gap_s), notes
