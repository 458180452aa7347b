"""Draws the views of submaps: the artifacts of scans and submaps in, an artifact of views out.

Each view is drawn from the points of its submap alone. Bird-views are not: they show a map of all
scans so far (`views.mapped`).
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.compute import Compute
from pipeline.core.errors import ArtifactError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Scans, Submaps, Views
from pipeline.mapping.gathering import submap_points
from pipeline.perturbations import Case

BLOCK = 64
"""Number of views drawn and written together."""
BLANK_BELOW = 0.01
"""A view whose values are all below this, in metres or its own unit, shows nothing."""
UNPERTURBED = [asdict(Case())]
"""The `cases` of an artifact whose queries are all unperturbed."""


class View(Protocol):
    """What every view can do: draw an image of a submap's points."""

    schema: ClassVar[type[Views]]
    """The schema of the artifact of such views."""

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[Any]:
        """Draw the image of points (n, 3) in metres, z up from the ground."""


@dataclass(frozen=True)
class Drawing:
    """Draws one view of every submap of an artifact."""

    scans: Scans
    submaps: Submaps
    view: View
    complaint: ClassVar[str] = (
        "all views are blank, nothing stands off the ground; lift_m, or submap: flat?"
    )
    """The error where all views are blank."""

    def __len__(self) -> int:
        return int(self.submaps["scans"].shape[0])

    @property
    def one_scan_each(self) -> bool:
        """Whether each submap is one scan, so that blocks of submaps can be drawn in parallel."""
        return bool((self.submaps["first"][:] == self.submaps["scans"][:]).all())

    def blocks(self, compute: Compute) -> Iterator[NDArray[Any]]:
        """Yield the images (BLOCK or fewer, …) of one block of submaps after the other.

        Submaps that share scans are drawn in order by one process, so that each scan is placed
        only once.
        """
        if self.one_scan_each:
            yield from compute.rows(self._block, len(self), BLOCK)
            return
        images = (self.view(points) for points in self.points())
        while block := list(islice(images, BLOCK)):
            yield np.stack(block)

    def write(self, path: Path, compute: Compute, progress: Progress) -> str:
        """Write all views as an artifact to `path`; returns a line on how many, of what shape.

        Raises ArtifactError if all are blank.
        """
        schema = self.view.schema
        tracked_blocks = progress.track(
            self.blocks(compute), math.ceil(len(self) / BLOCK), f"draw {path.stem}"
        )
        count = blank = 0
        with store.draft(path, schema, cases=UNPERTURBED) as out:
            for images in tracked_blocks:
                out.append("images", images)
                count += len(images)
                shows_something = self.shows(images).reshape(len(images), -1).any(axis=1)
                blank += int((~shows_something).sum())
            if blank == count:
                raise ArtifactError(f"{self.submaps.path}: {self.complaint}")
            for name in ("stamps_ns", "world_T_anchor"):
                out.put(name, self.submaps.load(name))
        sides = " × ".join(map(str, images.shape[1:]))
        names = ", ".join(schema.columns["images"].dims[1:]).replace("_px", "")
        line = f"{count} views of {sides} ({names})"
        return f"{line}, {blank} of them blank" if blank else line

    def shows(self, images: NDArray[Any]) -> NDArray[np.bool_]:
        """True where images (n, …) show something; a NaN counts as shown."""
        return np.asarray(~(images < BLANK_BELOW))

    def points(self) -> Iterator[NDArray[np.floating]]:
        """Yield the points (n, 3) in metres of one submap after the other, z up from the ground."""
        step = BLOCK if self.one_scan_each else max(len(self), 1)
        for start in range(0, len(self), step):
            yield from submap_points(self.scans, self.submaps, slice(start, start + step))

    def _block(self, start: int, stop: int) -> NDArray[Any]:
        """Images (stop − start, …) of the submaps from `start` to before `stop`, in a worker."""
        rows = slice(start, stop)
        points_of_submaps = submap_points(self.scans, self.submaps, rows)
        return np.stack([self.view(points) for points in points_of_submaps])
