"""Views of submaps, each from the points of that submap alone."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.core import store
from pipeline.core.compute import Compute
from pipeline.core.errors import ArtifactError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Scans, Submaps, Views
from pipeline.mapping.gathering import submap_points

BLOCK = 64
SEEN = 0.01
"""A view that nowhere reaches this, in metres or its own unit, shows nothing."""
AS_DRIVEN = [asdict(Case())]
"""The one case of views as they were driven."""


class View(Protocol):
    """Computes an image of a submap's points (n, 3) in metres, z up from the ground; `schema` is
    that of the artifact."""

    schema: ClassVar[type[Views]]

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.floating]: ...


@dataclass(frozen=True)
class Drawing:
    """Draws the rows of a submaps artifact from the points of a scans artifact."""

    scans: Scans
    submaps: Submaps
    view: View

    def __len__(self) -> int:
        return int(self.submaps["scans"].shape[0])

    @property
    def one_scan_each(self) -> bool:
        """Whether no two submaps share a scan, so that blocks of them can be drawn side by side."""
        return bool((self.submaps["first"][:] == self.submaps["scans"][:]).all())

    def blocks(self, compute: Compute) -> Iterator[NDArray[np.floating]]:
        """Images (BLOCK or fewer, …) of one block of submaps after the other.

        Submaps that share scans are drawn in order on one core, so that each scan is moved into
        their common frame once.
        """
        if self.one_scan_each:
            yield from compute.rows(self._block, len(self), BLOCK)
            return
        images = map(self.view, self.points())
        while block := list(islice(images, BLOCK)):
            yield np.stack(block)

    def write(self, path: Path, compute: Compute, progress: Progress) -> str:
        """All views as an artifact at `path`; returns how many, of what shape.

        Raises ArtifactError if all are blank.
        """
        blocks = progress.track(self.blocks(compute), -(-len(self) // BLOCK), f"draw {path.stem}")
        complaint = "all views are blank, nothing stands off the ground; lift_m, or submap: flat?"
        return write_views(
            path,
            self.view.schema,
            self.submaps,
            ((images, ~(images < SEEN)) for images in blocks),
            complaint,
        )

    def points(self) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) in metres of one submap after the other, z up from the ground."""
        step = BLOCK if self.one_scan_each else max(len(self), 1)
        for start in range(0, len(self), step):
            yield from submap_points(self.scans, self.submaps, slice(start, start + step))

    def _block(self, start: int, stop: int) -> NDArray[np.floating]:
        """Images (stop − start, …)."""
        return np.stack(
            [
                self.view(points)
                for points in submap_points(self.scans, self.submaps, slice(start, stop))
            ]
        )


def write_views(
    path: Path,
    schema: type[Views],
    submaps: Submaps,
    blocks: Iterable[tuple[NDArray[Any], NDArray[np.bool_]]],
    complaint: str,
) -> str:
    """Blocks of images (n, …), and where they show something, as an artifact; returns how many, of
    what shape.

    Raises ArtifactError with the complaint if all are blank.
    """
    count = blank = 0
    with store.draft(path, schema, cases=AS_DRIVEN) as out:
        for images, shows_something in blocks:
            out.append("images", images)
            count += len(images)
            blank += int((~shows_something.reshape(len(shows_something), -1).any(axis=1)).sum())
        if blank == count:
            raise ArtifactError(f"{submaps.path}: {complaint}")
        for name in ("stamps_ns", "world_T_anchor"):
            out.put(name, submaps.load(name))
    sides = " × ".join(map(str, images.shape[1:]))
    names = ", ".join(schema.columns["images"].dims[1:]).replace("_px", "")
    return f"{count} views of {sides} ({names})" + (f", {blank} of them blank" if blank else "")
