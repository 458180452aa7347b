"""Branch and bound over a whole level map: the best poses of a query, APART from one another.

After Hess, Kohler, Rapp and Andor, Real-Time Loop Closure in 2D LIDAR SLAM, ICRA 2016, section V,
but best first: nodes leave a queue in the order of their bounds, so the first leaf is the best pose
of all, and the next that is apart from it the runner-up. A node is a square of cells and a heading;
its bound is the sum over the query's points of the largest likelihood within the square that each
point sweeps.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import REACH_M, Field

POINTS = 128
"""A query is searched for by so many of its points at most: their sum in 255ths fits 16 bits."""
HEADINGS = 240
APART_M = 1.0
APART_DEG = 20.0
"""Poses nearer and less turned than this are one."""


@dataclass(frozen=True)
class BestPoses:
    """The best poses of a query on the cells of a field."""

    poses: NDArray[np.float64]
    """(k, 3) x, y in metres and heading in radians, in the grid; best first, apart."""
    scores: NDArray[np.float64]
    """(k,) the mean likelihood of the query's points there."""
    exact: bool
    """Whether the search ended before its limit: else better poses may have been missed."""


def search(
    field: Field,
    points_m: NDArray[np.float64],
    keep: int = 6,
    least_ratio: float = 0.75,
    most_nodes: int = 300_000,
    at_least: float = 0.0,
) -> BestPoses:
    """Find the `keep` best poses of points (n, 2), which score `at_least` so much.

    They also score `least_ratio` of the best or more. Points beyond REACH_M are left out. Without
    points there is no pose.
    """
    near = points_m[np.linalg.norm(points_m, axis=1) <= REACH_M]
    if not len(near):
        return BestPoses(np.empty((0, 3)), np.empty(0), True)
    chosen = near[np.linspace(0, len(near) - 1, min(POINTS, len(near))).round().astype(int)]
    pyramid = field.pyramid
    headings_rad = 2 * np.pi / HEADINGS * np.arange(HEADINGS)
    cos = np.cos(headings_rad)[:, None]
    sin = np.sin(headings_rad)[:, None]
    # the robot stands in the middle of a cell
    offsets = np.stack(
        [
            np.floor((sin * chosen[:, 0] + cos * chosen[:, 1]) / field.cell_m + 0.5),
            np.floor((cos * chosen[:, 0] - sin * chosen[:, 1]) / field.cell_m + 0.5),
        ],
        axis=2,
    ).astype(np.int32)
    rows, scores, exact = _search(
        pyramid.levels,
        pyramid.phases,
        pyramid.stands,
        pyramid.block_cols,
        pyramid.margin,
        offsets,
        keep,
        APART_M / field.cell_m,
        round(APART_DEG * HEADINGS / 360),
        least_ratio,
        most_nodes,
        at_least * 255 * len(chosen),
    )
    poses = np.column_stack(
        [
            (rows[:, 2] - pyramid.margin + 0.5) * field.cell_m,
            (rows[:, 1] - pyramid.margin + 0.5) * field.cell_m,
            headings_rad[rows[:, 0]],
        ]
    )
    return BestPoses(poses, scores / (255 * len(chosen)), bool(exact))


def scores(
    field: Field, points_m: NDArray[np.float64], poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The mean likelihood (k,) of points (n, 2) in poses (k, 3) in the grid."""
    cos = np.cos(poses[:, 2, None])
    sin = np.sin(poses[:, 2, None])
    x_m = poses[:, 0, None] + cos * points_m[:, 0] - sin * points_m[:, 1]
    y_m = poses[:, 1, None] + sin * points_m[:, 0] + cos * points_m[:, 1]
    rows = np.floor(y_m / field.cell_m).astype(int) + field.pyramid.margin
    cols = np.floor(x_m / field.cell_m).astype(int) + field.pyramid.margin
    likelihood = field.pyramid.levels[0]
    rows = rows.clip(0, likelihood.shape[0] - 1)
    cols = cols.clip(0, likelihood.shape[1] - 1)
    return np.asarray(likelihood[rows, cols].mean(axis=1) / 255)


@njit(cache=True, nogil=True)
def _search(  # type: ignore[no-untyped-def]
    levels,
    phases,
    stands,
    block_cols,
    margin,
    offsets,
    keep,
    apart_cells,
    apart_headings,
    least_ratio,
    most_nodes,
    least,
):
    """The best leaves (k, 3) as heading, row, column, their scores (k,), and if the limit held."""
    headings = offsets.shape[0]
    top = levels.shape[0] - 1
    block = 1 << top
    blocks, bounds = _coarse(phases, stands[top], block_cols, margin // block, block, offsets)
    order = _sorted(bounds)
    kept = np.empty((keep, 3), np.int64)
    kept_scores = np.empty(keep, np.int64)
    count = 0
    # a node is (level, heading, row, column, bound); the queue holds bound and number of each
    nodes = np.empty((most_nodes + 4, 5), np.int32)
    made = 0
    queue = [(np.int64(0), np.int64(-1))]
    queue.pop()
    following = 0
    exact = True
    while count < keep:
        score = -queue[0][0] if len(queue) else np.int64(-1)
        if following < len(order) and bounds[order[following]] >= score:
            number = order[following]
            following += 1
            score = np.int64(bounds[number])
            level = top
            heading = number // len(blocks)
            row = blocks[number % len(blocks)] // block_cols * block
            col = blocks[number % len(blocks)] % block_cols * block
        elif len(queue):
            taken = heapq.heappop(queue)[1]
            level = nodes[taken, 0]
            heading = nodes[taken, 1]
            row = nodes[taken, 2]
            col = nodes[taken, 3]
        else:
            break
        if score <= 0 or score < least:
            break
        if _is_near(
            kept, count, heading, row, col, 1 << level, headings, apart_cells, apart_headings
        ):
            continue
        if level == 0:
            kept[count, 0] = heading
            kept[count, 1] = row
            kept[count, 2] = col
            kept_scores[count] = score
            count += 1
            least = max(least, least_ratio * kept_scores[0])
            continue
        if made + 4 > most_nodes:
            exact = False
            break
        first = made
        made = _divided(
            levels, stands, offsets[heading], level, heading, row, col, nodes, made, least
        )
        for number in range(first, made):
            heapq.heappush(queue, (-np.int64(nodes[number, 4]), np.int64(number)))
    return kept[:count], kept_scores[:count], exact


@njit(cache=True, nogil=True)
def _divided(levels, stands, offsets, level, heading, row, col, nodes, made, least):  # type: ignore[no-untyped-def]
    """Add the quarters of a node to the `made` nodes, but those below `least`; returns how many."""
    half = 1 << (level - 1)
    for quarter in range(4):
        child_row = row + half * (quarter >> 1)
        child_col = col + half * (quarter & 1)
        if not stands[level - 1, child_row, child_col]:
            continue
        bound = np.int64(0)
        for point in range(len(offsets)):
            bound += levels[level - 1, child_row + offsets[point, 0], child_col + offsets[point, 1]]
        if bound < least:
            continue
        nodes[made] = level - 1, heading, child_row, child_col, bound
        made += 1
    return made


@njit(cache=True, nogil=True)
def _coarse(phases, stands, block_cols, margin_blocks, block, offsets):  # type: ignore[no-untyped-def]
    """The blocks where a robot may stand, and the bounds (heading * block,) of each."""
    headings = offsets.shape[0]
    points = offsets.shape[1]
    total_blocks = phases.shape[2]
    first = margin_blocks * block_cols
    last = total_blocks - first
    blocks = np.empty(last - first, np.int64)
    count = 0
    for number in range(first, last):
        if stands[number // block_cols * block, number % block_cols * block]:
            blocks[count] = number
            count += 1
    blocks = blocks[:count]
    bounds = np.empty(headings * count, np.uint16)
    length = last - first
    sums = np.empty(length, np.uint16)
    for heading in range(headings):
        sums[:] = 0
        for point in range(points):
            row = offsets[heading, point, 0] + margin_blocks * block
            col = offsets[heading, point, 1] + margin_blocks * block
            shift = (row // block) * block_cols + col // block - margin_blocks
            part = phases[row % block, col % block, shift : shift + length]
            for number in range(length):
                sums[number] += part[number]
        for number in range(count):
            bounds[heading * count + number] = sums[blocks[number] - first]
    return blocks, bounds


@njit(cache=True, nogil=True)
def _sorted(bounds):  # type: ignore[no-untyped-def]
    """The numbers of bounds (n,), the largest first."""
    starts = np.zeros(65_537, np.int64)
    for bound in bounds:
        starts[65_536 - bound] += 1
    total = np.int64(0)
    for number in range(65_537):
        before = total
        total += starts[number]
        starts[number] = before
    order = np.empty(len(bounds), np.int32)
    for number in range(len(bounds)):
        place = 65_536 - bounds[number]
        order[starts[place]] = number
        starts[place] += 1
    return order


@njit(cache=True, nogil=True, inline="always")
def _is_near(kept, count, heading, row, col, side, headings, apart_cells, apart_headings):  # type: ignore[no-untyped-def]
    """Whether all cells of a node are one with a pose that is kept."""
    for number in range(count):
        turn = abs(heading - kept[number, 0])
        turn = min(turn, headings - turn)
        if turn >= apart_headings:
            continue
        up = max(abs(row - kept[number, 1]), abs(row + side - 1 - kept[number, 1]))
        along = max(abs(col - kept[number, 2]), abs(col + side - 1 - kept[number, 2]))
        if up * up + along * along < apart_cells * apart_cells:
            return True
    return False
