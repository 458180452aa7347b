"""Training a classifier: fit, judged on held-out blocks, fitted again on all views, and what a
model then holds."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.matching import holdout
from pipeline.matching.ranking import Model, TrainingSet
from pipeline.matching.rejection import Evidence
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.evidence import Known, Prediction, judged
from pipeline.networks.lenet import device
from pipeline.running.progress import Progress


@dataclass(frozen=True)
class Training:
    """A network in training."""

    method: Classifier
    data: TrainingSet
    held: NDArray[np.bool_]
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
        """The same, quantized."""
        return self.method.heights(self.images)

    @cached_property
    def xy_m(self) -> NDArray[np.float64]:
        """(n, 2)."""
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
        """The end of the schedule, a share of it, on the batches of some rows; the curves of it."""
        method = self.method
        progress = self.progress.part(part) if part else self.progress
        chosen = torch.from_numpy(rows)
        places = torch.from_numpy(self.data.places)
        batches, steps = method.batches(self.heights, self.data.views, places, chosen)
        epochs = max(1, round(method.epochs * progress.budget * share))
        how: dict[str, Any] = {
            name: getattr(method, name)
            for name in ("learning_rate", "schedule", "precision", "seed")
        }
        how |= {"epochs": epochs, "steps": steps, "since": 1 - share, "step": self.step}
        return loop.fit(self.net, batches, judge, progress=progress, **how)

    def judge(self, net: nn.Module) -> tuple[float, float]:
        """Loss and accuracy on the held-out views."""
        logits = self.method.predict(net, self.heights[self.held]).logits
        classes = torch.from_numpy(self.data.places[self.held])
        return float(nn.functional.cross_entropy(logits, classes)), float(
            (logits.argmax(1) == classes).float().mean()
        )

    def remembered(self, rows: NDArray[np.int64]) -> tuple[Known, Tensor, Model]:
        """The features of some views or more, the row of each, and what else answers to queries are
        compared with."""
        views = self.data.views
        places = self.data.places
        chosen = torch.from_numpy(rows)
        features, found = self.method.embed_training(self.net, self.heights, views, chosen)
        kept = self.method.remembered(self.images, views, places, chosen)
        return Known(features, places[found], self.xy_m[found]), found, kept

    def evidence(self, rows: NDArray[np.int64], earlier: Model | None) -> tuple[float, Evidence]:
        """The temperature and the answers to held-out views, when `rows` are remembered."""
        usual = None if earlier is None else float(earlier["temperature"])
        if usual is not None and not self.held.any():
            return usual, Evidence.of(earlier or {})
        every, found, kept = self.remembered(rows)
        known = every.some(torch.isin(found, torch.from_numpy(rows)))
        images = self.images[self.held]

        def predict(heights: Tensor, forgotten: Tensor | None) -> Prediction:
            return self.method.reranked(
                self.method.predict(self.net, heights, forgotten), images, kept
            )

        asked = Known(self.heights, self.data.places, self.xy_m).some(self.held)
        near_m = self.method.neighbour_m
        world_T_anchor = self.data.views.world_T_anchor
        of_blocks = (self.method.held_out_every_m, self.method.held_out_length_m)
        block = holdout.numbered(world_T_anchor, self.held, *of_blocks)
        about = (asked, block, self.place_xy_m, known, near_m, self.progress, usual)
        softness, own = judged(predict, self.method.novelties, *about)
        return softness, own if earlier is None else Evidence.joined([Evidence.of(earlier), own])

    def model(
        self, softness: float, evidence: Evidence, rows: NDArray[np.int64], curves: Model
    ) -> Model:
        """All that was learned, `rows` remembered."""
        known, _, kept = self.remembered(rows)
        arrays = {
            "place_xy_m": self.place_xy_m,
            "memory": known.seen.numpy(),
            "memory_xy_m": known.xy_m,
            "temperature": np.array(softness),
            "image_shape": np.array(self.images.shape[1:]),
        }
        return {**loop.arrays(self.net), **arrays, **kept, **evidence.arrays(), **curves}


def learned(method: Classifier, data: TrainingSet, progress: Progress) -> Model:
    """A model of the first day: held-out blocks choose epoch, temperature and thresholds; then
    `refit` trains on all views."""
    held = blocks(method, data)
    trained = np.flatnonzero(~held)
    held = held if held.any() else ~held  # a path too short for blocks is judged on what it trained
    with loop.reproducible(method.threads):
        torch.manual_seed(method.seed)
        net = method.network(int(data.places.max()) + 1, *data.views.images.shape[1:]).to(device())
        training = Training(method, data, held, net, progress, method.step)
        curves = training.fit(trained, 1.0, judge=training.judge)
        chosen = training.evidence(trained, None)
        if method.refit:
            training.fit(trained := np.arange(len(data)), method.refit, "refit")
        return training.model(*chosen, trained, curves)


def blocks(method: Classifier, data: TrainingSet) -> NDArray[np.bool_]:
    """Which views (n,) are held out."""
    places = np.unique(data.places, return_inverse=True)[1]
    return holdout.blocks(
        data.views.world_T_anchor, places, method.held_out_every_m, method.held_out_length_m
    )
