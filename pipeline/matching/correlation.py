"""Correlative scan matching from above: where in a whole map a scan's walls fit best (METHODS 15).

In: the walls of a map, cell by cell, and a scan's walls and seen-through cells (views/walls.py).
Out: the positions and headings that fit best. A wall on a wall of the map raises the score, a wall
beside one by half as much, and a seen-through cell on a wall of the map lowers it.

1. Estimate the score of each block of positions at each heading: walls are compared with the
   highest cell of a block, seen-through cells with the mean of the block.
2. Compute the scores of all positions in the blocks that look best.
3. Keep the best positions that are some metres apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numba import njit
from numpy.typing import NDArray

from pipeline.core.settings import Count, NotNegative, Positive, checked
from pipeline.mapping.wall_chart import BESIDE, SEEN_THROUGH, WALL

BLOCK = 4
"""Positions along each side of a block."""
CELLS = BLOCK * BLOCK
LANES = 32
"""Blocks that are estimated together, in a strip along y: the bytes of four words."""
MOST_WALLS = np.iinfo(np.uint8).max // WALL
MOST_THROUGH = np.iinfo(np.uint8).max // CELLS
"""Values of a chart whose sum fits into a byte."""
MOST_SUMS = 12_000_000
"""Strips times headings times cells that are added at most; in a large map, cells are sampled."""
FEWEST_CELLS = 60
"""Walls, and seen-through cells, that a sample has at least."""
POOL = 2
"""The search begins with cells that are this many times as wide as the map's."""
FEWEST = 2
"""Wall points that make such a cell a wall: one alone may be a stray."""
FINE_CELLS = 3
"""Cells to each side of a position that are tried at last."""
DRAWN = "walls/"
"""Prefix of the arrays of a map of walls, in a model or a site."""
NEAR_CELLS = 1
"""Cells to each side of a given pose that are tried, for its score."""
FINE_HEADINGS = 5
"""Headings that are tried at last, half a step apart."""


@dataclass(frozen=True)
@checked("correlation")
class Correlation:
    """The settings of the search."""

    headings: Count = 60
    """Number of headings that are tried first, evenly spaced around the circle."""
    see_through: NotNegative = 0.3
    """A seen-through cell on a wall of the map costs this share of what a wall on a wall gains."""
    blocks: Count = 2000
    """Number of blocks of 8 cells of which all positions are computed."""
    apart_m: Positive = 4.0
    """Answers are at least this far apart."""


class Fits(NamedTuple):
    """The best positions of a scan in a map, the best first."""

    xy_m: NDArray[np.float64]
    """(k, 2) positions in the world."""
    heading_deg: NDArray[np.float64]
    """(k,) headings in the world, from 0 to 360."""
    scores: NDArray[np.float64]
    """(k,) 1 if each wall of the scan lies on a wall of the map, and nothing is contradicted."""


@dataclass(frozen=True)
class WallMap:
    """The walls of a whole map, from above."""

    counts: NDArray[np.uint8]
    """(x, y) the number of wall points in each cell, 255 if there are more."""
    is_candidate: NDArray[np.bool_]
    """(x, y) the cells in which a scan may have been taken."""
    corner_m: NDArray[np.float64]
    """(2,) the lower corner of cell (0, 0) in the world."""
    cell_m: float
    reach_cells: int
    """A scan has no walls farther from the robot than this."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], cell_m: float) -> Self:
        """The walls in the arrays of a model or of a site, whose cells have sides of `cell_m`."""
        return cls(
            arrays[DRAWN + "counts"],
            arrays[DRAWN + "is_candidate"].astype(bool),
            arrays[DRAWN + "corner_m"],
            cell_m,
            int(arrays[DRAWN + "reach_cells"][0]),
        )

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that a model or a site keeps."""
        return {
            DRAWN + "counts": self.counts,
            DRAWN + "is_candidate": self.is_candidate.astype(np.uint8),
            DRAWN + "corner_m": np.asarray(self.corner_m, np.float64),
            DRAWN + "reach_cells": np.array([self.reach_cells]),
        }

    @cached_property
    def chart(self) -> NDArray[np.uint8]:
        """(x, y) WALL, BESIDE or 0, with a border that a scan at the edge reaches into."""
        return _chart(self._padded(self.counts) > 0)

    def window(self, xy_m: NDArray[np.float64], half_width_cells: int) -> NDArray[np.int8]:
        """WALL, BESIDE or 0 in the 2 `half_width_cells` cells a side around a position (2,)."""
        middle = np.rint((xy_m - self.corner_m) / self.cell_m).astype(np.int64) + self._low
        low, high = middle - half_width_cells, middle + half_width_cells
        inside_low, inside_high = low.clip(0), high.clip(0, self.chart.shape)
        window = np.zeros((2 * half_width_cells, 2 * half_width_cells), np.int8)
        into = tuple(
            slice(*edges) for edges in zip(inside_low - low, inside_high - low, strict=True)
        )
        part = tuple(slice(*edges) for edges in zip(inside_low, inside_high, strict=True))
        if (inside_high > inside_low).all():
            window[into] = self.chart[part]
        return window

    def near(self, xy_m: NDArray[np.float64], reach_m: float) -> "WallMap":
        """The same walls, with only the candidates up to `reach_m` from a position (2,)."""
        x_m, y_m = (
            corner_m + (np.arange(size) + 0.5) * self.cell_m
            for corner_m, size in zip(self.corner_m, self.is_candidate.shape, strict=True)
        )
        is_near = np.hypot(x_m[:, None] - xy_m[0], y_m - xy_m[1]) <= reach_m + self.cell_m
        narrowed = replace(self, is_candidate=self.is_candidate & is_near)
        # All that is computed once for a map stays, but its candidates.
        for name in ("chart", "_coarse", "_blocks", "_coarse_words", "_is_in_reach"):
            narrowed.__dict__[name] = getattr(self, name)
        return narrowed

    def fits(self, scan: NDArray[np.int8], k: int, search: Correlation) -> Fits:
        """The `k` best positions of a scan, given its walls (x, y) from above (views/walls.py)."""
        strips, _ = self._strips
        walls, _ = self._cells_in_reach(scan)
        if not len(walls) or not len(strips):
            return Fits(np.empty((0, 2)), np.empty(0), np.empty(0))
        cell, heading_rad = self._rough_fits(scan, k, search)
        cell, heading_rad, scores = self._fine_fits(scan, cell, heading_rad, FINE_CELLS, search)
        order = np.argsort(-scores, kind="stable")
        xy_m = self.corner_m + (cell[order] - self._low) * self.cell_m
        return Fits(xy_m, np.rad2deg(heading_rad[order]) % 360.0, scores[order])

    def score_at(
        self,
        scan: NDArray[np.int8],
        xy_m: NDArray[np.float64],
        heading_deg: float,
        search: Correlation,
    ) -> float:
        """The score of a scan (x, y) at a position (2,) in the world, as in `Fits`.

        It is the best score within NEAR_CELLS cells and one step of headings; 0 without walls.
        Positions beyond the border of the map score 0.
        """
        walls, _ = self._cells_in_reach(scan)
        cell = np.rint((xy_m - self.corner_m) / self.cell_m).astype(np.int64) + self._low
        reach_cells = self.reach_cells + NEAR_CELLS + 1
        is_inside = (cell >= reach_cells).all() and (cell + reach_cells < self.chart.shape).all()
        if not len(walls) or not is_inside:
            return 0.0
        heading_rad = np.deg2rad(np.array([heading_deg]))
        _, _, scores = self._fine_fits(scan, cell[None], heading_rad, NEAR_CELLS, search)
        return float(scores[0])

    def _fine_fits(
        self,
        scan: NDArray[np.int8],
        cell: NDArray[np.int64],
        heading_rad: NDArray[np.float64],
        around_cells: int,
        search: Correlation,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """The best cells (k, 2), headings (k,) and scores (k,) around cells of the chart.

        Cells up to `around_cells` to each side are tried.
        """
        walls, through = self._cells_in_reach(scan)
        turns = (np.arange(FINE_HEADINGS) - FINE_HEADINGS // 2) * (np.pi / search.headings)
        tried_rad = (heading_rad[:, None] + turns).ravel()
        sums, tried_cell = _best_around(
            self.chart,
            np.repeat(cell, FINE_HEADINGS, axis=0) - around_cells,
            2 * around_cells + 1,
            _turned(walls, tried_rad),
            _turned(through, tried_rad),
            search.see_through,
        )
        sums = sums.reshape(-1, FINE_HEADINGS)
        rows = np.arange(len(cell)) * FINE_HEADINGS + sums.argmax(axis=1)
        scores = sums.max(axis=1) / (WALL * len(walls))
        return tried_cell[rows], tried_rad[rows], scores

    def _cells_in_reach(
        self, scan: NDArray[np.int8]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The walls (n, 2) and the seen-through cells (m, 2) of a scan, from its middle.

        Cells that lie beyond the border of the map at some heading are left out.
        """
        scan = np.where(self._is_in_reach, scan, 0)
        return _cells(scan == WALL), _cells(scan == SEEN_THROUGH)

    def _rough_fits(
        self, scan: NDArray[np.int8], k: int, search: Correlation
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The best cells (k, 2) of the padded chart and headings (k,), by cells POOL as wide."""
        scan = np.where(self._is_in_reach, scan, 0)
        headings = search.headings
        walls = _cells(np.asarray(_pooled(scan == WALL).any(axis=(1, 3))))
        through = _cells(np.asarray(_pooled(scan == SEEN_THROUGH).all(axis=(1, 3))))

        # Estimate all blocks at every second heading, from a sample of the cells if need be.
        rough_rad = _angles(headings)[::2]
        strips, has_candidate = self._strips
        most = MOST_SUMS // (len(strips) * len(rough_rad))
        wall_sample, wall_share = _sampled(walls, max(most // 2, FEWEST_CELLS))
        through_sample, through_share = _sampled(through, max(most // 2, FEWEST_CELLS))
        highest, wall_counts = self._blocks
        estimates = _estimates(
            highest,
            wall_counts,
            strips @ (self._coarse.shape[1] // BLOCK, 1),
            self._offsets(_turned(wall_sample, rough_rad)),
            self._offsets(_turned(through_sample, rough_rad)),
            search.see_through * wall_share / through_share,
        )

        # Compute the best blocks, at the headings beside theirs too.
        estimates[:, ~has_candidate] = -np.inf
        count = min(search.blocks, len(rough_rad) * int(has_candidate.sum()))
        chosen = np.argpartition(estimates.ravel(), -count)[-count:]
        rough, strip, lane = np.unravel_index(chosen, estimates.shape)
        corner = (strips[strip] + np.column_stack([np.zeros_like(lane), lane])) * BLOCK
        angles = _angles(headings)
        heading = (2 * rough[:, None] + (-1, 0, 1)) % headings
        width = self._coarse.shape[1]
        sums, cell = _best_in_blocks(
            *self._coarse_words,
            np.repeat(corner @ (width, 1), 3),
            heading.ravel(),
            width,
            _turned(walls, angles) @ (width, 1),
            _turned(through, angles) @ (width, 1),
            search.see_through,
        )
        heading = heading.ravel()
        order = np.argsort(-sums, kind="stable")
        kept = order[_apart(cell[order], search.apart_m / (POOL * self.cell_m), k)]
        return cell[kept] * POOL, angles[heading[kept]]

    @property
    def _low(self) -> int:
        """Cells of the border before the map, along each axis."""
        side = POOL * BLOCK
        return side * -(-(self.reach_cells + side) // side)

    def _padded(self, cells: NDArray[Any]) -> NDArray[Any]:
        """The cells (x, y) with a border, so that each side is a multiple of POOL BLOCK cells.

        Behind the last block along y is room for the other blocks of its strip.
        """
        side = POOL * BLOCK
        strip = side * (LANES - 1)
        high_x, high_y = (self._low + -size % side for size in cells.shape)
        return np.pad(cells, [(self._low, high_x), (self._low, high_y + strip)])

    @cached_property
    def _coarse(self) -> NDArray[np.uint8]:
        """The chart (x, y) of cells POOL as wide, in which a wall has FEWEST points."""
        counts = _pooled(self._padded(self.counts)).sum(axis=(1, 3))
        return _chart(counts >= FEWEST)

    @cached_property
    def _blocks(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """Two charts of the coarse chart, as words for `_add`: the highest cell of the block that
        begins at each cell, and its number of walls."""
        chart = self._coarse
        highest = np.zeros_like(chart)
        walls = np.zeros_like(chart)
        width, depth = (size - BLOCK + 1 for size in chart.shape)
        for a in range(BLOCK):
            for b in range(BLOCK):
                part = chart[a : a + width, b : b + depth]
                np.maximum(highest[:width, :depth], part, out=highest[:width, :depth])
                walls[:width, :depth] += part == WALL
        return _words(_phases(highest)), _words(_phases(walls))

    @cached_property
    def _coarse_words(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """The coarse chart, and its walls, as words for `_sum_block`."""
        chart = self._coarse.ravel()
        return _words(chart), _words((chart == WALL).astype(np.uint8))

    def _offsets(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """The offsets (…,) of cells (…, 2) from a block in the bytes of `_blocks`."""
        x_count, y_count = (size // BLOCK for size in self._coarse.shape)
        (x, y), (x_phase, y_phase) = (
            np.moveaxis(cells // BLOCK, -1, 0),
            np.moveaxis(cells % BLOCK, -1, 0),
        )
        return np.asarray(((x_phase * BLOCK + y_phase) * x_count + x) * y_count + y)

    @cached_property
    def _strips(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The strips of blocks with candidates: the first block (strip, 2) of each, along x and y,
        and which of its blocks (strip, LANES) have candidates."""
        padded = self._padded(self.is_candidate)
        x, y = (size // (POOL * BLOCK) for size in padded.shape)
        squares = padded.reshape(x, POOL * BLOCK, y, POOL * BLOCK)
        has_candidate = np.asarray(squares.any(axis=(1, 3)))
        strips: list[tuple[int, int]] = []
        for row in np.flatnonzero(has_candidate.any(axis=1)).tolist():
            columns = np.flatnonzero(has_candidate[row])
            while len(columns):
                strips.append((row, int(columns[0])))
                columns = columns[columns >= columns[0] + LANES]
        first = np.array(strips, np.int64).reshape(-1, 2)
        lanes = first[:, 1:] + np.arange(LANES)
        return first, np.asarray(has_candidate[first[:, :1], lanes])

    @cached_property
    def _is_in_reach(self) -> NDArray[np.bool_]:
        """The cells (x, y) of a scan that walls nearer than `reach_cells` may lie in."""
        side_cells = np.arange(2 * self.reach_cells) - self.reach_cells + 0.5
        away_cells = np.hypot(side_cells[:, None], side_cells)
        return np.asarray(away_cells <= self.reach_cells + np.sqrt(0.5))


def drawn_map(
    wall: NDArray[np.int64],
    visited: NDArray[np.int64],
    candidates_m: float,
    cell_m: float,
    reach_cells: int,
) -> WallMap:
    """The map of cells with walls (n, 2), each as often as it has points, in whole cells.

    Candidates are the cells up to `candidates_m` along each axis from those `visited` (m, 2).
    """
    both = np.concatenate([wall, visited])
    border = int(np.ceil(candidates_m / cell_m))
    low = both.min(axis=0) - border
    shape = both.max(axis=0) - low + border + 1
    counts = np.bincount((wall - low) @ (shape[1], 1), minlength=int(shape.prod()))
    is_visited = np.zeros(shape, bool)
    is_visited[tuple((visited - low).T)] = True
    return WallMap(
        counts.reshape(shape).clip(0, 255).astype(np.uint8),
        np.asarray(scipy.ndimage.maximum_filter(is_visited, 2 * border + 1), bool),
        low * cell_m,
        cell_m,
        reach_cells,
    )


def _chart(is_wall: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """WALL in cells (x, y) with walls, BESIDE in their neighbours, 0 elsewhere."""
    dilated = scipy.ndimage.maximum_filter(is_wall, 3)
    return np.where(is_wall, WALL, np.where(dilated, BESIDE, 0)).astype(np.uint8)


def _pooled(cells: NDArray[Any]) -> NDArray[Any]:
    """Cells (x, y) in squares: (x / POOL, POOL, y / POOL, POOL)."""
    x, y = (size // POOL for size in cells.shape)
    return cells[: x * POOL, : y * POOL].reshape(x, POOL, y, POOL)


def _sampled(cells: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], float]:
    """At most `count` cells (n, 2), drawn with a fixed seed, and their share of all."""
    if len(cells) <= count:
        return cells, 1.0
    return np.random.default_rng(0).permutation(cells)[:count], count / len(cells)


def _phases(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cells (x, y) in the order phase of x, phase of y, block along x, block along y.

    So the cells at the same position in neighbouring blocks lie side by side.
    """
    x, y = (size // BLOCK for size in cells.shape)
    return np.asarray(cells.reshape(x, BLOCK, y, BLOCK).transpose(1, 3, 0, 2)).ravel()


def _words(cells: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Bytes (n,) as words (shift, word) of eight, each beginning `shift` bytes later."""
    padded = np.pad(cells, (0, 16 + -len(cells) % 8))
    size = len(padded) - 8
    shifted = [padded[shift : shift + size] for shift in range(8)]
    return np.stack(shifted).view("<u8").astype(np.uint64)


def _cells(is_one: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The centres (n, 2), from the middle of the image, of the cells (x, y) that are True."""
    return np.asarray(np.argwhere(is_one) - np.array(is_one.shape) / 2 + 0.5, np.float64)


def _angles(headings: int) -> NDArray[np.float64]:
    """Headings (n,) in radians, evenly spaced around the circle."""
    return np.arange(headings, dtype=np.float64) * (2 * np.pi / headings)


def _turned(middles: NDArray[np.float64], angles_rad: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cells (angle, n, 2) of centres (n, 2) that are turned by angles about the middle."""
    cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    return np.asarray(np.floor(np.einsum("abh,nb->hna", rotation, middles)), np.int64)


def _apart(cells: NDArray[np.int64], apart: float, k: int) -> list[int]:
    """The first `k` rows of cells (n, 2) that are `apart` cells from the rows kept before."""
    kept: list[int] = []
    is_free = np.ones(len(cells), bool)
    while len(kept) < k and is_free.any():
        row = int(is_free.argmax())
        kept.append(row)
        is_free &= ((cells - cells[row]) ** 2).sum(axis=1) >= apart**2
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _estimates(highest, wall_counts, starts, walls, through, see_through):  # type: ignore[no-untyped-def]
    """The estimated score (heading, strip, LANES) of each block in the strips."""
    estimates = np.empty((len(walls), len(starts), LANES), np.float32)
    gains = np.empty(LANES, np.uint32)
    losses = np.empty(LANES, np.uint32)
    factor = np.float32(2 * see_through / CELLS)
    for strip in range(len(starts)):  # the headings of a strip read the same part of the charts
        for heading in range(len(walls)):
            _add(highest, starts[strip], walls[heading], MOST_WALLS, gains)
            _add(wall_counts, starts[strip], through[heading], MOST_THROUGH, losses)
            for lane in range(LANES):
                estimates[heading, strip, lane] = gains[lane] - factor * losses[lane]
    return estimates


@njit(cache=True, nogil=True, error_model="numpy")
def _add(words, start, offsets, at_once, sums):  # type: ignore[no-untyped-def]
    """Sum the bytes of a chart at offsets (n,) from the blocks of the strip that begins at `start`.

    `words` (shift, word) has eight bytes to a word, beginning at each shift. Sums of `at_once`
    values fit into a byte, so eight blocks are summed by one addition.
    """
    sums[:] = 0
    for first in range(0, len(offsets), at_once):
        a = np.uint64(0)
        b = np.uint64(0)
        c = np.uint64(0)
        d = np.uint64(0)
        for i in range(first, min(first + at_once, len(offsets))):
            place = start + offsets[i]
            shift = place & 7
            word = place >> 3
            a += words[shift, word]
            b += words[shift, word + 1]
            c += words[shift, word + 2]
            d += words[shift, word + 3]
        for number, total in enumerate((a, b, c, d)):
            for lane in range(8):
                sums[8 * number + lane] += (total >> np.uint64(8 * lane)) & np.uint64(255)


@njit(cache=True, nogil=True, error_model="numpy")
def _best_in_blocks(words, wall_words, starts, headings, width, walls, through, see_through):  # type: ignore[no-untyped-def]
    """The best sum (block,) in each block at its heading, and the cell (block, 2) that has it."""
    best = np.empty(len(starts))
    cells = np.empty((len(starts), 2), np.int64)
    gains = np.empty((BLOCK, BLOCK), np.uint32)
    losses = np.empty((BLOCK, BLOCK), np.uint32)
    for block in range(len(starts)):
        _sum_block(words, starts[block], walls[headings[block]], MOST_WALLS, width, gains)
        _sum_block(wall_words, starts[block], through[headings[block]], 255, width, losses)
        best[block] = -np.inf
        for a in range(BLOCK):
            for b in range(BLOCK):
                total = gains[a, b] - 2 * see_through * losses[a, b]
                if total > best[block]:
                    best[block] = total
                    cells[block] = starts[block] // width + a, starts[block] % width + b
    return best, cells


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_block(words, start, offsets, at_once, width, sums):  # type: ignore[no-untyped-def]
    """Sum the bytes of a chart of rows of `width` cells at offsets (n,) from each cell of a block.

    `words` and `at_once` are as in `_add`; a word has the cells of one row of the block.
    """
    sums[:] = 0
    for first in range(0, len(offsets), at_once):
        a = np.uint64(0)
        b = np.uint64(0)
        c = np.uint64(0)
        d = np.uint64(0)
        for i in range(first, min(first + at_once, len(offsets))):
            place = start + offsets[i]
            a += words[place & 7, place >> 3]
            place += width
            b += words[place & 7, place >> 3]
            place += width
            c += words[place & 7, place >> 3]
            place += width
            d += words[place & 7, place >> 3]
        for row, total in enumerate((a, b, c, d)):
            for lane in range(BLOCK):
                sums[row, lane] += (total >> np.uint64(8 * lane)) & np.uint64(255)


@njit(cache=True, nogil=True, error_model="numpy")
def _best_around(chart, corners, side, walls, through, see_through):  # type: ignore[no-untyped-def]
    """The best sum (try,) in the square of `side` cells that begins at each corner.

    Each try has its own heading: `walls` and `through` are (try, n, 2). Returns the cells (try, 2)
    of the best sums, too.
    """
    best = np.empty(len(corners))
    cells = np.empty((len(corners), 2), np.int64)
    gains = np.empty((side, side), np.int32)
    losses = np.empty((side, side), np.int32)
    for number in range(len(corners)):
        first_x, first_y = corners[number]
        gains[:] = 0
        losses[:] = 0
        for i in range(walls.shape[1]):
            x = first_x + walls[number, i, 0]
            y = first_y + walls[number, i, 1]
            for a in range(side):
                for b in range(side):
                    gains[a, b] += chart[x + a, y + b]
        for i in range(through.shape[1]):
            x = first_x + through[number, i, 0]
            y = first_y + through[number, i, 1]
            for a in range(side):
                for b in range(side):
                    losses[a, b] += chart[x + a, y + b] == WALL
        best[number] = -np.inf
        for a in range(side):
            for b in range(side):
                total = gains[a, b] - 2 * see_through * losses[a, b]
                if total > best[number]:
                    best[number] = total
                    cells[number] = first_x + a, first_y + b
    return best, cells
