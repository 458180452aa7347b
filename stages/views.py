"""Stage `views`: draws one view of each submap, such as a Scan Context, for the methods.

It reads the scans and submaps of each sequence, and writes one artifact of views for each sequence.
Bird-views, whose octree remembers earlier scans, have their own stage, `birdviews`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.progress import Progress
from pipeline.views.draw import Drawing
from stages import EachSequence, ProgressBar, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/views.yaml."""

    view: Any
    """Draws the views: a file of conf/view."""
    scans: Path
    submaps: Path


@stage("views")
def main(settings: Settings) -> str:
    def draw(sequence: str, folder: Path) -> str:
        """Write the views of one sequence, in one thread."""
        return write_views(settings, sequence, folder, Compute(workers=1), Progress())

    first_drawing = open_drawing(settings, settings.sequences[0])
    if not first_drawing.one_scan_each:
        # neighbouring submaps share scans, so sequences, not blocks of submaps, run in parallel
        return each_sequence(settings, draw, "draw")
    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        folder.mkdir()
        return "; ".join(
            write_views(settings, sequence, folder, compute, ProgressBar())
            for sequence in settings.sequences
        )


def open_drawing(settings: Settings, sequence: str) -> Drawing:
    """Open the scans and submaps of one sequence, ready to be drawn."""
    name = f"{sequence}.zarr"
    return Drawing(
        store.read(settings.scans / name, schemas.Scans),
        store.read(settings.submaps / name, schemas.Submaps),
        settings.view,
    )


def write_views(
    settings: Settings, sequence: str, folder: Path, compute: Compute, progress: Progress
) -> str:
    """Write the views of one sequence; returns a one-line summary.

    `compute` draws blocks of its submaps in parallel.
    """
    drawing = open_drawing(settings, sequence)
    return f"{sequence}: {drawing.write(folder / f'{sequence}.zarr', compute, progress)}"


if __name__ == "__main__":
    main()
