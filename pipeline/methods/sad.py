"""SAD: sequences of bird-views compared pixel by pixel at one heading; nothing is trained (Milford
and Wyeth, ICRA 2012).

SeqSLAM's differences, paper 2's baseline; METHODS 5.5 and 6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.matching.database import Database, MadeAnew
from pipeline.matching.patches import differences, normalised, resized
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import Evidence
from pipeline.matching.sequences import SequenceMethod
from pipeline.running.progress import Progress
from pipeline.running.settings import Count, Positive, Side, Whole


@dataclass(frozen=True)
class Sad(MadeAnew, SequenceMethod):
    """Views are compared at the robot's own heading, so a turned view is a different image; answers
    have no heading."""

    view: str = "birdview"
    side_px: Side = 64  # views are brought to this side
    patch_px: Count = 8  # side of the patches that are normalised
    contrast_rows: Whole = 10
    held_out_every_m: Positive = 80.0
    """Nothing is trained, so held-out blocks cost nothing; between them lies the length of a
    sequence."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """The training sequence's normalised images (n, side, side), 4 KB each.

        Raises InputError unless each has a place.
        """
        database = Database.learned(views, places)
        images = self._images(views)
        evidence = self.evidence(
            database, views, lambda rows, queries: differences(images[rows], images[queries])
        )
        return {"images": images, **database.arrays(), **evidence.arrays()}

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The model with these views and places as its database.

        The evidence of its held-out blocks is kept.
        """
        database = Database.learned(views, places)
        return {"images": self._images(views), **database.arrays(), **Evidence.of(model).arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The training rows along the best sequence; views passed together are one sequence."""
        database = Database.of(model)
        images = model["images"]

        def localize(views: Rows, k: int) -> Ranking:
            return self.ranked(database, differences(images, self._images(views)), k)

        return localize

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """No image: pixels are compared as they are."""
        return images[:0]

    def _images(self, views: Rows) -> NDArray[np.uint8]:
        """Each view's first heading, the robot's own."""
        if len(views.images.shape) != 4:
            raise InputError(
                f"views of shape {views.images.shape}: expected bird-views (n, heading, row, "
                "column)"
            )
        return normalised(resized(np.asarray(views.images[:, 0]), self.side_px), self.patch_px)
