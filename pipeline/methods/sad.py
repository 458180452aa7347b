"""SAD: sequences of bird-views compared pixel by pixel at one heading; nothing is trained (Milford
and Wyeth, ICRA 2012).

SeqSLAM's differences, paper 2's baseline; METHODS 5.5 and 6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Side, Whole
from pipeline.matching.database import Database, UntrainedMethod
from pipeline.matching.headings import ReferenceHeadings, reference_headings
from pipeline.matching.patches import differences, normalised, resized
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import Evidence
from pipeline.matching.sequences import SequenceMethod


@dataclass(frozen=True)
class Sad(UntrainedMethod, SequenceMethod):
    """Views are compared at the robot's own heading, so a turned view is a different image; answers
    have no heading, unless several are kept of a place."""

    view: str = "birdview"
    side_px: Side = 64
    """Views are brought to this side."""
    patch_px: Count = 8
    """Side of the patches that are normalised."""
    contrast_rows: Whole = 10
    reference_headings: ReferenceHeadings = 1
    """Headings of a place whose images are kept: SeqSLAM's one, or up to the eight that PFL's codes
    have."""
    held_out_every_m: Positive = 80.0
    """Nothing is trained, so held-out blocks cost nothing; between them lies the length of a
    sequence."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """The training sequence's normalised images (n, heading, side, side), 4 KB each.

        Raises InputError unless each has a place.
        """
        database = Database.learned(views, places)
        images = self._reference(views)
        images_ahead = images[:, 0]  # as the robot was headed

        def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
            return nearest_differences(images[rows], images_ahead[queries])[0]

        evidence = self.evidence(database, views, difference)
        return {"images": images, **database.arrays(), **evidence.arrays()}

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The model with these views and places as its database.

        The evidence of its held-out blocks is kept.
        """
        database = Database.learned(views, places)
        evidence = Evidence.of(model)
        return {"images": self._reference(views), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The training rows along the best sequence; views passed together are one sequence."""
        database = Database.of(model)
        images = model["images"]

        def localize(views: Rows, k: int) -> Ranking:
            sums, bins = nearest_differences(images, self._images(views, slice(1))[:, 0])
            if images.shape[1] == 1:
                return self.ranked(database, sums, k)
            return self.ranked(database, sums, k, bins * np.float32(360 / images.shape[1]))

        return localize

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """No image: pixels are compared as they are."""
        return images[:0]

    def _reference(self, views: Rows) -> NDArray[np.uint8]:
        """The normalised images of each view's reference headings (n, heading, side, side)."""
        _check(views)
        headings = reference_headings(views.images.shape[1], self.reference_headings)
        return self._images(views, headings)

    def _images(self, views: Rows, headings: slice) -> NDArray[np.uint8]:
        """Each view's normalised images (n, heading, side, side); the first is the robot's own."""
        _check(views)
        images = np.asarray(views.images[:, headings])
        flat = resized(images.reshape(-1, *images.shape[2:]), self.side_px)
        return normalised(flat, self.patch_px).reshape(*images.shape[:2], *flat.shape[1:])


def nearest_differences(
    references: NDArray[np.uint8], queries: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Differences (n, m) of queries (m, side, side) from the nearest heading of each reference.

    And that heading (n, m), of equally near ones the first. References are (n, heading, side,
    side).
    """
    sums = differences(references[:, 0], queries)
    bins = np.zeros(sums.shape, np.uint8)
    for heading in range(1, references.shape[1]):
        other_sums = differences(references[:, heading], queries)
        nearer = other_sums < sums
        np.copyto(sums, other_sums, where=nearer)
        np.copyto(bins, np.uint8(heading), where=nearer)
    return sums, bins


def _check(views: Rows) -> None:
    """Raise InputError unless the views are bird-views."""
    if len(views.images.shape) != 4:
        raise InputError(
            f"views of shape {views.images.shape}: expected bird-views (n, heading, row, column)"
        )
