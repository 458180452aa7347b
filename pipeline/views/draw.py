"""Drawing the views of submaps."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.gathering import Gathering
from pipeline.running.compute import Compute
from pipeline.schemas import Schema
from pipeline.store import Artifact

BLOCK = 64


class View(Protocol):
    """What is drawn of a submap's points (n, 3) in metres, z up from the ground; `schema` says how it is kept."""

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
    def single(self) -> bool:
        """Whether each submap is one scan."""
        return bool((self.submaps["first"][:] == self.submaps["scans"][:]).all())

    def blocks(self, compute: Compute) -> Iterator[NDArray[np.floating]]:
        """Images (BLOCK or fewer, …) of one block of submaps after the other.

        Submaps of one scan each are drawn side by side; those that share scans in order, so that each scan is laid out once.
        """
        if self.single:
            yield from compute.rows(self._single, len(self), BLOCK)
            return
        images = map(self.view, self.points())
        while block := list(islice(images, BLOCK)):
            yield np.stack(block)

    def points(self) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) in metres of one submap after the other, z up from the ground."""
        if self.single:
            for start in range(0, len(self), BLOCK):
                yield from self._points(start, min(start + BLOCK, len(self)))
        else:
            columns = {name: self.submaps.load(name) for name in ("first", "ground_m", "used")}
            yield from Gathering(self.scans, self.submaps.attrs["layout"], last=self.submaps.load("scans"), **columns)

    def _single(self, start: int, stop: int) -> NDArray[np.floating]:
        """Images (stop − start, …) of submaps of one scan each."""
        return np.stack([self.view(points) for points in self._points(start, stop)])

    def _points(self, start: int, stop: int) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) of submaps of one scan each, which are read in one slice."""
        rows = np.asarray(self.submaps["scans"][start:stop])
        offsets = np.asarray(self.scans["offsets"][rows[0] : rows[-1] + 2])
        points = np.asarray(self.scans["points"][offsets[0] : offsets[-1]])
        grain_m = float(self.scans.attrs["grain_m"])
        for row in rows - rows[0]:
            yield points[offsets[row] - offsets[0] : offsets[row + 1] - offsets[0]] * grain_m
