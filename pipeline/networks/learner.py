"""A classifier that learns places, and more of them later."""

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

        Raises ConfigError or InputError where they do not suit the network.
        """
        return training.learned(self, TrainingSet.joined([TrainingSet(views, places)]), progress)

    def grow(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Train on with further days.

        Raises InputError where its views or places do not follow those of the model.
        """
        return growth.grown(self, model, known_set, new_set, progress)
