"""A classifier that learns the places of the training day, and more of them on further days.

It joins `Classifier`, which answers, with `training` and `growth`, which learn.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Rows, TrainingSet
from pipeline.networks import growth, training
from pipeline.networks.classifier import Classifier


class Learner(Classifier):
    """The base of SCI and its ring: learns places, and further days."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on the views of the training sequence.

        Raises ConfigError or InputError if they do not suit the network.
        """
        return training.trained_model(
            self, TrainingSet.joined([TrainingSet(views, places)]), progress
        )

    def grow(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Train on with the views of further days.

        Raises InputError if their views or places do not continue those of the model.
        """
        return growth.grown_model(self, model, known_set, new_set, progress)
