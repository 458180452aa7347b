"""Stage `birdviews`: draws bird-views, pictures from above of an octree built from the scans.

It reads the scans of each sequence in the order of the drive, since the octree remembers earlier
scans, and writes one picture of each submap at each heading.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.progress import Progress
from pipeline.views.mapped import MappedViews
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/birdviews.yaml."""

    view: Any
    """A view that is drawn from an octree: a file of conf/view."""
    scans: Path
    submaps: Path


@stage("birdviews")
def main(settings: Settings) -> str:
    def draw(sequence: str, folder: Path) -> str:
        """Write the bird-views of one sequence."""
        name = f"{sequence}.zarr"
        scans = store.read(settings.scans / name, schemas.Scans)
        submaps = store.read(settings.submaps / name, schemas.Submaps)
        drawing = MappedViews(scans, submaps, settings.view)
        return f"{sequence}: {drawing.write(folder / name, Compute(workers=1), Progress())}"

    return each_sequence(settings, draw, "draw")


if __name__ == "__main__":
    main()
