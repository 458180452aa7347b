"""Branch and bound over a whole level map: the best distinct poses of a query.

After Hess, Kohler, Rapp and Andor, Real-Time Loop Closure in 2D LIDAR SLAM, ICRA 2016, section V,
but best first: nodes leave a queue in the order of their bounds, so the first leaf is the best pose
of all, and the next leaf at another pose is the runner-up. A node is a square of cells and a
heading; its bound is the sum, over the query's points, of the largest likelihood within the square
that the point sweeps. A leaf is a node of one cell. Likelihoods come from field.py.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import REACH_M, Field

POINTS = 128
"""Largest number of a query's points that are used: the sum of their likelihoods, each 0 to 255,
fits into 16 bits."""
HEADINGS = 240
"""Number of headings that are tried: they are 1.5° apart."""
APART_M = 1.0
APART_DEG = 20.0
"""Two poses that differ by less than both of these count as the same pose."""


@dataclass(frozen=True)
class BestPoses:
    """The best poses of a query on the cells of a field."""

    poses: NDArray[np.float64]
    """(k, 3) x, y in metres and heading in radians, in the grid; the best first, all distinct."""
    scores: NDArray[np.float64]
    """(k,) the mean likelihood of the query's points at each pose."""
    exact: bool
    """Whether the search ended before `most_nodes`; otherwise better poses may be missed."""


@dataclass(frozen=True)
class Window:
    """A square of positions, and a range of headings, that a search is limited to."""

    x_m: float
    y_m: float
    """The middle of the square in the grid."""
    reach_m: float
    """Half the side of the square."""
    heading_rad: float | None
    """The middle of the headings in the grid; None for all."""
    reach_rad: float
    """The largest turn from this heading."""

    def cells(self, field: Field) -> tuple[int, int, int, int]:
        """The first row and column, and the last row and column, of the pyramid."""
        rows, cols = field.pyramid.levels.shape[1:]
        margin = field.pyramid.margin
        cell_m = field.cell_m
        low, high = (
            np.floor(np.array([self.y_m + off_m, self.x_m + off_m]) / cell_m) + margin
            for off_m in (-self.reach_m, self.reach_m)
        )
        first = low.clip(0, (rows, cols)).astype(int)
        last = high.clip(-1, (rows - 1, cols - 1)).astype(int)
        return int(first[0]), int(first[1]), int(last[0]), int(last[1])

    def headings(self) -> NDArray[np.float64]:
        """The headings (n,) that are tried, in radians and in order."""
        step_rad = 2 * np.pi / HEADINGS
        if self.heading_rad is None or self.reach_rad >= np.pi - step_rad:
            return np.asarray(step_rad * np.arange(HEADINGS), np.float64)
        count = int(np.ceil(self.reach_rad / step_rad))
        middle = round(self.heading_rad / step_rad)
        return np.asarray(step_rad * np.arange(middle - count, middle + count + 1), np.float64)


def search(
    field: Field,
    points_m: NDArray[np.float64],
    keep: int = 6,
    min_ratio: float = 0.75,
    most_nodes: int = 300_000,
    min_score: float = 0.0,
    window: Window | None = None,
) -> BestPoses:
    """Find the `keep` best poses of points (n, 2), in metres in the robot's frame.

    Their scores are at least `min_score`, and at least `min_ratio` times the best score. Points
    beyond REACH_M are left out. Without points there is no pose. The search ends after
    `most_nodes` nodes. Only poses within a `window` are found, if there is one.
    """
    near = points_m[np.linalg.norm(points_m, axis=1) <= REACH_M]
    if not len(near):
        return BestPoses(np.empty((0, 3)), np.empty(0), True)
    chosen = near[np.linspace(0, len(near) - 1, min(POINTS, len(near))).round().astype(int)]
    pyramid = field.pyramid
    headings_rad = 2 * np.pi / HEADINGS * np.arange(HEADINGS)
    rows, cols = pyramid.levels.shape[1:]
    cells = (0, 0, rows - 1, cols - 1)
    if window is not None:
        headings_rad, cells = window.headings(), window.cells(field)
    cos = np.cos(headings_rad)[:, None]
    sin = np.sin(headings_rad)[:, None]
    # (heading, point, 2) rows and columns from the robot, at the centre of its cell, to each point
    offsets = np.stack(
        [
            np.floor((sin * chosen[:, 0] + cos * chosen[:, 1]) / field.cell_m + 0.5),
            np.floor((cos * chosen[:, 0] - sin * chosen[:, 1]) / field.cell_m + 0.5),
        ],
        axis=2,
    ).astype(np.int32)
    leaves, summed_likelihoods, exact = _search(
        pyramid.levels,
        pyramid.phases,
        pyramid.can_stand,
        pyramid.block_cols,
        pyramid.margin,
        offsets,
        keep,
        APART_M / field.cell_m,
        round(APART_DEG * HEADINGS / 360),
        min_ratio,
        most_nodes,
        min_score * 255 * len(chosen),
        cells,
    )
    leaf_headings, leaf_rows, leaf_cols = leaves.T
    poses = np.column_stack(
        [
            (leaf_cols - pyramid.margin + 0.5) * field.cell_m,
            (leaf_rows - pyramid.margin + 0.5) * field.cell_m,
            headings_rad[leaf_headings],
        ]
    )
    return BestPoses(poses, summed_likelihoods / (255 * len(chosen)), bool(exact))


def mean_likelihoods(
    field: Field, points_m: NDArray[np.float64], poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The mean likelihood (k,) of points (n, 2) at poses (k, 3) in the grid."""
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
    can_stand,
    block_cols,
    margin,
    offsets,
    keep,
    apart_cells,
    apart_headings,
    min_ratio,
    most_nodes,
    min_score,
    window,
):
    """The best leaves (k, 3) as heading, row, column; their scores (k,), and whether all are found.

    The first five arguments are fields of the Pyramid; `offsets` (heading, point, 2) are the rows
    and columns from the robot to its points. `keep` is the largest number of leaves;
    `apart_cells` and `apart_headings` are APART_M and APART_DEG on the grid. Here scores are sums
    of likelihoods in 255ths. `window` is the first row and column, and the last row and column, of
    the leaves. Headings are neighbours that are 1 / HEADINGS of a turn apart.
    """
    top = levels.shape[0] - 1
    block = 1 << top
    # each of the coarsest nodes is a block at a heading; they are sorted once by their bounds
    blocks, bounds = _coarse(
        phases, can_stand[top], block_cols, margin // block, block, offsets, window
    )
    order = _largest_first(bounds)
    next_in_order = 0
    # finer nodes are (level, heading, row, column, bound); the heap holds −bound and a number
    nodes = np.empty((most_nodes, 5), np.int32)
    node_count = 0
    heap = [(np.int64(0), np.int64(-1))]  # this tells numba its type
    heap.pop()
    leaves = np.empty((keep, 3), np.int64)
    leaf_scores = np.empty(keep, np.int64)
    count = 0
    exact = True
    while count < keep:
        # take the node of the highest bound: the next in order, or the top of the heap. The
        # coarsest nodes are not on the heap, since most of them are never reached
        score = -heap[0][0] if len(heap) else np.int64(-1)
        if next_in_order < len(order) and bounds[order[next_in_order]] >= score:
            number = order[next_in_order]
            next_in_order += 1
            score = np.int64(bounds[number])
            level = top
            heading = number // len(blocks)
            row = blocks[number % len(blocks)] // block_cols * block
            col = blocks[number % len(blocks)] % block_cols * block
        elif len(heap):
            node = heapq.heappop(heap)[1]
            level = nodes[node, 0]
            heading = nodes[node, 1]
            row = nodes[node, 2]
            col = nodes[node, 3]
        else:
            break
        if score <= 0 or score < min_score:
            break  # no remaining node has a higher bound
        if _is_near(
            leaves, count, heading, row, col, 1 << level, HEADINGS, apart_cells, apart_headings
        ):
            continue
        # a leaf is the next best pose, since its bound is its score
        if level == 0:
            leaves[count, 0] = heading
            leaves[count, 1] = row
            leaves[count, 2] = col
            leaf_scores[count] = score
            count += 1
            min_score = max(min_score, min_ratio * leaf_scores[0])
            continue
        # any other node is divided into quarters
        if node_count + 4 > most_nodes:  # there may be no room for four more
            exact = False
            break
        first = node_count
        node_count = _divide(
            levels,
            can_stand,
            offsets[heading],
            level,
            heading,
            row,
            col,
            nodes,
            first,
            min_score,
            window,
        )
        for number in range(first, node_count):
            heapq.heappush(heap, (-np.int64(nodes[number, 4]), np.int64(number)))
    return leaves[:count], leaf_scores[:count], exact


@njit(cache=True, nogil=True)
def _divide(  # type: ignore[no-untyped-def]
    levels,
    can_stand,
    offsets,
    level,
    heading,
    row,
    col,
    nodes,
    node_count,
    min_score,
    window,
):
    """Write the quarters of a node into `nodes`, from number `node_count` on.

    Quarters outside of the window, where no robot can stand, or with a bound below `min_score`, are
    left out. Returns the new number of nodes.
    """
    half = 1 << (level - 1)
    for quarter in range(4):
        child_row = row + half * (quarter >> 1)
        child_col = col + half * (quarter & 1)
        if not can_stand[level - 1, child_row, child_col]:
            continue
        if not _overlaps(child_row, child_col, half, window):
            continue
        bound = np.int64(0)
        for point in range(len(offsets)):
            bound += levels[level - 1, child_row + offsets[point, 0], child_col + offsets[point, 1]]
        if bound < min_score:
            continue
        nodes[node_count] = level - 1, heading, child_row, child_col, bound
        node_count += 1
    return node_count


@njit(cache=True, nogil=True)
def _coarse(phases, can_stand, block_cols, margin_blocks, block, offsets, window):  # type: ignore[no-untyped-def]
    """The numbers (m,) of the blocks where a robot can stand, and their bounds at each heading.

    Bounds are (headings times m,): those of all blocks at the first heading, then at the second,
    and so on. The position of a point in its block, its phase, is the same for all blocks in which
    the robot may stand. So the likelihoods of one point for all these blocks are one slice of
    `phases`, and slices are added faster than values that are looked up one by one.
    """
    headings = offsets.shape[0]
    points = offsets.shape[1]
    total_blocks = phases.shape[2]
    # the rows of blocks above and below the map are left out, so that no slice leaves `phases`
    first = max(margin_blocks, window[0] // block) * block_cols
    last = min(total_blocks - margin_blocks * block_cols, (window[2] // block + 1) * block_cols)
    last = max(first, last)
    blocks = np.empty(last - first, np.int64)
    count = 0
    for number in range(first, last):
        row = number // block_cols * block
        col = number % block_cols * block
        if can_stand[row, col] and _overlaps(row, col, block, window):
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
            # the block in which the point lies if the robot stands in the block `first`
            start = (row // block) * block_cols + col // block - margin_blocks
            start += first - margin_blocks * block_cols
            likelihoods = phases[row % block, col % block, start : start + length]
            for number in range(length):
                sums[number] += likelihoods[number]
        for number in range(count):
            bounds[heading * count + number] = sums[blocks[number] - first]
    return blocks, bounds


@njit(cache=True, nogil=True)
def _largest_first(bounds):  # type: ignore[no-untyped-def]
    """The numbers of bounds (n,), the largest first.

    It is a counting sort, since bounds have 16 bits and there may be millions of them.
    """
    # count how often each bound occurs, then find where in the order its first number stands
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
def _overlaps(row, col, side, window):  # type: ignore[no-untyped-def]
    """Whether a square of `side` cells that begins at (row, col) overlaps the window."""
    is_row = row <= window[2] and row + side > window[0]
    return is_row and col <= window[3] and col + side > window[1]


@njit(cache=True, nogil=True, inline="always")
def _is_near(leaves, count, heading, row, col, side, headings, apart_cells, apart_headings):  # type: ignore[no-untyped-def]
    """Whether all cells of a node count as the same pose as one of the first `count` leaves.

    The node is the square of `side` cells that begins at (row, col).
    """
    for number in range(count):
        turn = abs(heading - leaves[number, 0])
        turn = min(turn, headings - turn)
        if turn >= apart_headings:
            continue
        up = max(abs(row - leaves[number, 1]), abs(row + side - 1 - leaves[number, 1]))
        along = max(abs(col - leaves[number, 2]), abs(col + side - 1 - leaves[number, 2]))
        if up * up + along * along < apart_cells * apart_cells:
            return True
    return False
