"""Trains a classifier: fit, judged on held-out blocks, then fitted again on all views."""

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
from pipeline.matching.rejection import Evidence
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.evidence import KnownViews, Prediction, judge_held_out
from pipeline.networks.lenet import device


@dataclass(frozen=True)
class Training:
    """A network in training, with its data and settings."""

    method: Classifier
    data: TrainingSet
    is_held_out: NDArray[np.bool_]
    """(submap,) which views are held out, until everything is chosen."""
    net: nn.Module
    progress: Progress
    step: loop.Step[Any]

    @cached_property
    def images(self) -> NDArray[np.float32]:
        """Heights (n, rings, sectors) in metres."""
        return np.asarray(self.data.views.images[:])

    @cached_property
    def heights(self) -> Tensor:
        """The images, quantized, on the device."""
        return self.method.heights(self.images).to(device())

    @cached_property
    def xy_m(self) -> NDArray[np.float64]:
        """Positions (n, 2) of the views."""
        return self.data.views.world_T_anchor[:, :2, 3]

    @cached_property
    def place_xy_m(self) -> NDArray[np.float64]:
        """The mean position (place, 2) of each place's views."""
        places = self.data.places
        xy_m = self.xy_m
        return np.stack(
            [np.bincount(places, xy_m[:, axis]) / np.bincount(places) for axis in (0, 1)], axis=1
        )

    def fit(
        self, rows: NDArray[np.int64], share: float, part: str = "", judge: loop.Judge | None = None
    ) -> Model:
        """Train on the batches of some rows and return the curves.

        For the last `share` of the schedule.
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
        """Loss and accuracy on the held-out views."""
        logits = self.method.predict(net, self.heights[self.is_held_out]).logits
        classes = torch.from_numpy(self.data.places[self.is_held_out])
        return float(nn.functional.cross_entropy(logits, classes)), float(
            (logits.argmax(1) == classes).float().mean()
        )

    def remembered(self, rows: NDArray[np.int64]) -> tuple[KnownViews, Tensor, Model]:
        """Features of some views or more, the row of each, and the arrays `reranked` needs."""
        views = self.data.views
        places = self.data.places
        trained = torch.from_numpy(rows)
        features, feature_rows = self.method.embed_training(self.net, self.heights, views, trained)
        remembered_arrays = self.method.remembered(self.images, views, places, trained)
        views_known = KnownViews(features, places[feature_rows], self.xy_m[feature_rows])
        return views_known, feature_rows, remembered_arrays

    def evidence(self, rows: NDArray[np.int64], earlier: Model | None) -> tuple[float, Evidence]:
        """The temperature and the evidence of held-out views, when `rows` are remembered."""
        earlier_temperature = None if earlier is None else float(earlier["temperature"])
        if earlier_temperature is not None and not self.is_held_out.any():
            return earlier_temperature, Evidence.of(earlier or {})
        all_views, feature_rows, remembered_arrays = self.remembered(rows)
        known_views = all_views.some(torch.isin(feature_rows, torch.from_numpy(rows)))
        images = self.images[self.is_held_out]

        def predict(heights: Tensor, forgotten: Tensor | None) -> Prediction:
            return self.method.reranked(
                self.method.predict(self.net, heights, forgotten), images, remembered_arrays
            )

        held_out_views = KnownViews(self.heights, self.data.places, self.xy_m).some(
            self.is_held_out
        )
        world_T_anchor = self.data.views.world_T_anchor
        of_blocks = (self.method.held_out_every_m, self.method.held_out_length_m)
        block = holdout.numbered(world_T_anchor, self.is_held_out, *of_blocks)
        softness, evidence = judge_held_out(
            predict,
            self.method.novelties,
            held_out_views,
            block,
            self.place_xy_m,
            known_views,
            self.method.neighbour_m,
            self.progress,
            earlier_temperature,
        )
        if earlier is not None:
            evidence = Evidence.joined([Evidence.of(earlier), evidence])
        return softness, evidence

    def model(
        self, softness: float, evidence: Evidence, rows: NDArray[np.int64], curves: Model
    ) -> Model:
        """The arrays of the model, with `rows` remembered."""
        known_views, _, remembered_arrays = self.remembered(rows)
        arrays = {
            "place_xy_m": self.place_xy_m,
            "memory": known_views.seen.numpy(),
            "memory_xy_m": known_views.xy_m,
            "temperature": np.array(softness),
            "image_shape": np.array(self.images.shape[1:]),
        }
        return {
            **loop.arrays(self.net),
            **arrays,
            **remembered_arrays,
            **evidence.arrays(),
            **curves,
        }


def learned(method: Classifier, data: TrainingSet, progress: Progress) -> Model:
    """The model of the first day, with epoch, temperature and thresholds of held-out blocks.

    Then `refit` trains on all views.
    """
    is_held_out = blocks(method, data)
    trained = np.flatnonzero(~is_held_out)
    if not is_held_out.any():  # a path too short for blocks is judged on what it trained
        is_held_out = ~is_held_out
    with loop.reproducible(method.threads):
        torch.manual_seed(method.seed)
        net = method.network(int(data.places.max()) + 1, *data.views.images.shape[1:]).to(device())
        training = Training(method, data, is_held_out, net, progress, method.step)
        curves = training.fit(trained, 1.0, judge=training.judge)
        softness, evidence = training.evidence(trained, None)
        if method.refit:
            training.fit(trained := np.arange(len(data)), method.refit, "refit")
        return training.model(softness, evidence, trained, curves)


def blocks(method: Classifier, data: TrainingSet) -> NDArray[np.bool_]:
    """Which views (n,) are held out."""
    places = np.unique(data.places, return_inverse=True)[1]
    return holdout.blocks(
        data.views.world_T_anchor, places, method.held_out_every_m, method.held_out_length_m
    )
