"""Views of submaps, each from the points of that submap alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.gathering import submap_points
from pipeline.running.compute import Compute
from pipeline.schemas import Schema
from pipeline.store import Artifact

BLOCK = 64


class View(Protocol):
    """Computes an image of a submap's points (n, 3) in metres, z up from the ground; `schema` is that of the artifact."""

    schema: ClassVar[Schema]

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.floating]: ...


@dataclass(frozen=True)
class Drawing:
    """Draws the rows of a submaps artifact from the points of a scans artifact."""

    scans: Artifact
    submaps: Artifact
    view: View

    def __len__(self) -> int:
        return int(self.submaps["scans"].shape[0])

    @property
    def one_scan_each(self) -> bool:
        """Whether no two submaps share a scan, so that blocks of them can be drawn side by side."""
        return bool((self.submaps["first"][:] == self.submaps["scans"][:]).all())

    def blocks(self, compute: Compute) -> Iterator[NDArray[np.floating]]:
        """Images (BLOCK or fewer, …) of one block of submaps after the other.

        Submaps that share scans are drawn in order on one core, so that each scan is moved into their common frame once.
        """
        if self.one_scan_each:
            yield from compute.rows(self._block, len(self), BLOCK)
            return
        images = map(self.view, self.points())
        while block := list(islice(images, BLOCK)):
            yield np.stack(block)

    def points(self) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) in metres of one submap after the other, z up from the ground."""
        step = BLOCK if self.one_scan_each else max(len(self), 1)
        for start in range(0, len(self), step):
            yield from submap_points(self.scans, self.submaps, slice(start, start + step))

    def _block(self, start: int, stop: int) -> NDArray[np.floating]:
        """Images (stop − start, …)."""
        return np.stack([self.view(points) for points in submap_points(self.scans, self.submaps, slice(start, stop))])
