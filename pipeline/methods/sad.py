"""SAD: sequences of bird-views compared pixel by pixel at one heading; nothing is trained (Milford
and Wyeth, ICRA 2012).

It uses the differences of SeqSLAM, the baseline of paper 2 (METHODS 5.5 and 6). `learn` stores the
normalised images of the training sequence. `localizer` computes the sum of absolute differences of
a query from each image, and ranks training rows by sequences of these sums.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Side
from pipeline.matching.database import Database, UntrainedMethod
from pipeline.matching.headings import ReferenceHeadings, least_by_heading, reference_headings
from pipeline.matching.patches import differences, normalised, resized
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import NoveltyEvidence
from pipeline.matching.sequences import NormalisationRows, SequenceMethod


@dataclass(frozen=True)
class Sad(UntrainedMethod, SequenceMethod):
    """The settings of SAD: how training images are normalised, and at which headings.

    Queries are compared at the robot's own heading. So a turned query is a different image, and
    answers have no heading, unless several headings of each training place are stored.
    """

    view: str = "birdview"
    side_px: Side = 64
    """Views are resized to this side."""
    patch_px: Count = 8
    """Side of the patches in which images are normalised."""
    normalisation_rows: NormalisationRows = 10
    reference_headings: ReferenceHeadings = 1
    """The number of headings of a training place whose images are stored: one as in SeqSLAM, or up
    to eight, the number of PFL."""
    validation_every_m: Positive = 80.0
    """There are more validation blocks than for PFL and AFL, since without training they cost
    nothing; the length of a sequence lies between two blocks."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Store the training sequence's normalised images (n, heading, side, side), 4 KB each.

        Raises InputError unless each view has a place.
        """
        database = Database.learned(views, places)
        images = self._reference(views)
        images_ahead = images[:, 0]  # as the robot was headed

        def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
            sums, _ = nearest_differences(images[rows], images_ahead[queries])
            return sums

        evidence = self.evidence(database, views, difference)
        return {"images": images, **database.arrays(), **evidence.arrays()}

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The model with these views and places as its database.

        The evidence stays that of the training sequence's validation blocks.
        """
        database = Database.learned(views, places)
        evidence = NoveltyEvidence.of(model)
        return {"images": self._reference(views), **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """Rank training rows by sequences; views that are passed together are one sequence."""
        database = Database.of(model)
        images = model["images"]

        def localize(views: Rows, k: int) -> Ranking:
            images_ahead = self._images(views, slice(1))[:, 0]
            sums, headings = nearest_differences(images, images_ahead)
            if images.shape[1] == 1:
                return self.ranked(database, sums, k)
            heading_deg = headings * np.float32(360 / images.shape[1])
            return self.ranked(database, sums, k, heading_deg)

        return localize

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """No images, since SAD has no network that reconstructs them."""
        return images[:0]

    def _reference(self, views: Rows) -> NDArray[np.uint8]:
        """The normalised images of each view's reference headings (n, heading, side, side)."""
        _check(views)
        headings = reference_headings(views.images.shape[1], self.reference_headings)
        return self._images(views, headings)

    def _images(self, views: Rows, headings: slice) -> NDArray[np.uint8]:
        """Each view's normalised images (n, heading, side, side) at headings; 0 is its own."""
        _check(views)
        images = np.asarray(views.images[:, headings])
        flat = resized(images.reshape(-1, *images.shape[2:]), self.side_px)
        return normalised(flat, self.patch_px).reshape(*images.shape[:2], *flat.shape[1:])


def nearest_differences(
    references: NDArray[np.uint8], queries: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """The differences (n, m) of m queries from n references, each at its nearest heading (n, m).

    Queries are images (m, side, side), references images (n, heading, side, side). Of equally near
    headings the first counts. Returns the differences and the headings.
    """
    return least_by_heading(differences(images, queries) for images in references.swapaxes(0, 1))


def _check(views: Rows) -> None:
    """Raise InputError unless the views are bird-views."""
    if len(views.images.shape) != 4:
        raise InputError(
            f"views of shape {views.images.shape}: expected bird-views (n, heading, row, column)"
        )
