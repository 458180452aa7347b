"""The parts of training a network on a first day and on further days (METHODS 2, 11.1).

`Learner` (learner.py) combines them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.core.progress import Progress
from pipeline.matching import holdout
from pipeline.matching.ranking import Model, TrainingSet
from pipeline.matching.rejection import NoveltyEvidence
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.evidence import KnownViews, Prediction, calibrate_on_validation
from pipeline.networks.lenet import device


@dataclass(frozen=True)
class Training:
    """A network in training, with its data and settings."""

    method: Classifier
    data: TrainingSet
    is_validation: NDArray[np.bool_]
    """(n,) which views are in validation blocks, and are not trained on until `refit`."""
    net: nn.Module
    progress: Progress
    step: loop.Step[Any]
    """Computes the loss of a batch."""

    @cached_property
    def images(self) -> NDArray[np.float32]:
        """The views: heights (n, rings, sectors) in metres."""
        return np.asarray(self.data.views.images[:])

    @cached_property
    def heights(self) -> Tensor:
        """The views as quantized heights (n, rings, sectors), on the device."""
        return self.method.heights(self.images).to(device())

    @cached_property
    def xy_m(self) -> NDArray[np.float64]:
        """Positions (n, 2) of the views in the world, in metres."""
        return self.data.views.world_T_anchor[:, :2, 3]

    @cached_property
    def place_xy_m(self) -> NDArray[np.float64]:
        """The mean position (places, 2) of each place's views in the world, in metres."""
        places = self.data.places
        xy_m = self.xy_m
        return np.stack(
            [np.bincount(places, xy_m[:, axis]) / np.bincount(places) for axis in (0, 1)], axis=1
        )

    def fit(
        self, rows: NDArray[np.int64], share: float, part: str = "", judge: loop.Judge | None = None
    ) -> Model:
        """Train on some rows for the last `share` of the schedule, and return the curves.

        `part` names what is trained in the progress shown.
        """
        method = self.method
        progress = self.progress.part(part) if part else self.progress
        trained = torch.from_numpy(rows)
        places = torch.from_numpy(self.data.places)
        batches, steps = method.batches(self.heights, self.data.views, places, trained)
        epochs = max(1, round(method.epochs * progress.budget * share))
        settings: dict[str, Any] = {
            name: getattr(method, name)
            for name in ("learning_rate", "schedule", "precision", "seed")
        }
        settings |= {"epochs": epochs, "steps": steps, "since": 1 - share, "step": self.step}
        return loop.fit(self.net, batches, judge, progress=progress, **settings)

    def judge(self, net: nn.Module) -> tuple[float, float]:
        """Loss and accuracy on the validation views."""
        logits = self.method.predict(net, self.heights[self.is_validation]).logits
        classes = torch.from_numpy(self.data.places[self.is_validation])
        loss = float(nn.functional.cross_entropy(logits, classes))
        accuracy = float((logits.argmax(1) == classes).float().mean())
        return loss, accuracy

    def remembered(self, rows: NDArray[np.int64]) -> tuple[KnownViews, Tensor, Model]:
        """The data of some views that the localizer needs: features, and arrays of the method.

        Returns the features as views with their places, the row of each feature, and the arrays
        (for `reranked`). A method may return features of further rows too.
        """
        views = self.data.views
        places = self.data.places
        trained = torch.from_numpy(rows)
        features, feature_rows = self.method.embed_training(self.net, self.heights, views, trained)
        remembered_arrays = self.method.remembered(self.images, views, places, trained)
        known_views = KnownViews(features, places[feature_rows], self.xy_m[feature_rows])
        return known_views, feature_rows, remembered_arrays

    def evidence(
        self, rows: NDArray[np.int64], earlier: Model | None
    ) -> tuple[float, NoveltyEvidence]:
        """The temperature and the evidence of the validation views, if `rows` are remembered.

        The evidence of an `earlier` model is joined to it. If there is no validation view,
        temperature and evidence are the earlier model's.
        """
        earlier_temperature = None if earlier is None else float(earlier["temperature"])
        if earlier_temperature is not None and not self.is_validation.any():
            return earlier_temperature, NoveltyEvidence.of(earlier or {})
        all_views, feature_rows, remembered_arrays = self.remembered(rows)
        # Validation views must not be among the remembered views.
        known_views = all_views.select(torch.isin(feature_rows, torch.from_numpy(rows)))
        images = self.images[self.is_validation]

        def predict(heights: Tensor, left_out: Tensor | None) -> Prediction:
            """The outputs for validation views, without the places in the mask `left_out`."""
            prediction = self.method.predict(self.net, heights, left_out)
            return self.method.reranked(prediction, images, remembered_arrays)

        all_heights = KnownViews(self.heights, self.data.places, self.xy_m)
        validation_views = all_heights.select(self.is_validation)
        block = holdout.number_blocks(
            self.data.views.world_T_anchor,
            self.is_validation,
            self.method.validation_every_m,
            self.method.validation_length_m,
        )
        temperature, evidence = calibrate_on_validation(
            predict=predict,
            novelties=self.method.novelties,
            validation=validation_views,
            block=block,
            place_xy_m=self.place_xy_m,
            memory=known_views,
            neighbour_m=self.method.neighbour_m,
            progress=self.progress,
            fallback=earlier_temperature,
        )
        if earlier is not None:
            evidence = NoveltyEvidence.joined([NoveltyEvidence.of(earlier), evidence])
        return temperature, evidence

    def model(
        self, temperature: float, evidence: NoveltyEvidence, rows: NDArray[np.int64], curves: Model
    ) -> Model:
        """The arrays of the model, which remembers `rows`."""
        known_views, _, remembered_arrays = self.remembered(rows)
        arrays = {
            "place_xy_m": self.place_xy_m,
            "memory": known_views.content.numpy(),
            "memory_xy_m": known_views.xy_m,
            "temperature": np.array(temperature),
            "image_shape": np.array(self.images.shape[1:]),
        }
        return {
            **loop.arrays(self.net),
            **arrays,
            **remembered_arrays,
            **evidence.arrays(),
            **curves,
        }


def blocks(method: Classifier, data: TrainingSet) -> NDArray[np.bool_]:
    """True for the views (n,) in validation blocks of the path, by the method's settings."""
    _, places = np.unique(data.places, return_inverse=True)  # numbered without gaps
    return holdout.blocks(
        data.views.world_T_anchor, places, method.validation_every_m, method.validation_length_m
    )
