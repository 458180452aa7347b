"""A network over Scan Context Images whose classes are places (METHODS 2).

The part that SCI and its ring share.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from torch import Tensor, nn

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import (
    Count,
    NotNegative,
    Positive,
    Seed,
    Share,
    SomeShare,
    Whole,
    check,
)
from pipeline.matching.novelties import novelties
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.networks import loop
from pipeline.networks.evidence import Prediction
from pipeline.networks.lenet import device, sent
from pipeline.views.scan_context import colours, quantize

Kinds = dict[str, NDArray[np.float64]]  # kind of novelty to its values (n,)


@dataclass(frozen=True)
class Classifier(ABC):
    """Settings, training judged on held-out blocks, and answers by softmax.

    A method adds its network and its batches.
    """

    architecture: ClassVar[type[nn.Module]]
    view: str = "scan_context_authors"
    colormap: Literal["jet", "grey"] = "jet"
    h_min_m: float = 0.0
    h_max_m: float = 15.0
    """Heights are clipped to [h_min_m, h_max_m] before they are coloured."""
    epochs: Count = 200
    batch: Count = 64
    learning_rate: Positive = 0.002
    schedule: loop.Schedule = "one_cycle"
    """The authors' is constant; falling at the end is what makes a short training good."""
    dropout: Share = 0.7
    batch_norm_momentum: Share = 0.1
    """The authors' 0.01 needs some 500 steps to forget the first weights: more than a short
    training has."""
    precision: loop.Precision = (
        "auto"  # of training and of answers; the last layer always answers in f32
    )
    threads: Count = 2
    """Fixed, since the order of sums follows from it and the weights from that."""
    seed: Seed = 0
    held_out_every_m: Positive = 40.0
    held_out_length_m: Positive = 4.0
    """One block of this length in every `held_out_every_m` of the training path chooses the epoch
    and the threshold."""
    neighbour_m: NotNegative = 20.0
    """A held-out query counts as unseen once the places and training views nearer than this are
    forgotten."""
    refit: Share = 0.0
    """Share of the schedule, its end, that is run once more on all views, once held-out blocks have
    given all that is chosen."""
    grown: SomeShare = 0.3
    """Share of the schedule, its end, in which further days are learned."""
    rehearsed: Whole = 2
    """Views of each known place, those of the highest loss, that are shown again
    with further days."""
    distilled: NotNegative = (
        0.0  # weight of the distance to the earlier network's answers in the loss of further days
    )

    def __post_init__(self) -> None:
        check(self, "method")
        if not self.h_min_m < self.h_max_m:
            raise ConfigError(
                f"method.h_max_m={self.h_max_m}: expected more than method.h_min_m={self.h_min_m}"
            )

    def network(self, places: int, rings: int, sectors: int) -> nn.Module:
        """The network before training; raises InputError for views that do not suit it."""
        channels = len(colours(self.colormap)[0])
        return self.architecture(
            places, rings, sectors, channels, self.dropout, self.batch_norm_momentum
        )

    @abstractmethod
    def batches(
        self, heights: Tensor, views: Rows, places: Tensor, trained: Tensor
    ) -> tuple[loop.Batches[Any], int]:
        """The batches of an epoch over the rows `trained` (m,), and how many there are."""

    @abstractmethod
    def predict(self, net: Any, heights: Tensor, forgotten: Tensor | None = None) -> Prediction:
        """Outputs for quantized heights (n, rings, sectors).

        Places `forgotten` (n, places) get a logit of −∞.
        """

    @abstractmethod
    def embed_training(
        self, net: Any, heights: Tensor, views: Rows, trained: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Features (m, 64) of training views, of length 1, and the row (m,) of each.

        A query's nearest view is found by them.
        """

    def remembered(
        self, images: NDArray[np.float32], views: Rows, places: NDArray[np.int64], trained: Tensor
    ) -> Model:
        """Arrays of the model that `reranked` needs of the trained views.

        Their heights (n, rings, sectors) are in metres.
        """
        return {}

    def reranked(
        self, prediction: Prediction, images: NDArray[np.float32], model: Model
    ) -> Prediction:
        """The outputs for heights (n, rings, sectors) in metres, compared with remembered views.

        By default as they are.
        """
        return prediction

    def novelties(
        self, logits: NDArray[np.float64], softness: float, likeness: NDArray[np.float64]
    ) -> Kinds:
        """Kinds of novelty (n,) of logits (n, places) at a temperature, the one in use first.

        `likeness` (n,) is the cosine to the likest training view.
        """
        return novelties(logits, softness, likeness)

    def localizer(self, model: Model) -> Localizer:
        """Rank the k places of highest softmax; cost = 1 − probability."""
        place_xy = model["place_xy_m"]
        softness = float(model["temperature"])
        rings, sectors = (int(side) for side in model["image_shape"])
        net = self.filled(model)
        loop.cast(net, device(), self.precision)
        memory = torch.from_numpy(model["memory"].copy())

        def localize(views: Rows, k: int) -> Ranking:
            images = np.asarray(views.images[:])
            heights = self.heights(images)
            if heights.shape[1:] != (rings, sectors):
                raise InputError(
                    f"views of {tuple(heights.shape[1:])}: the model learned {rings} rings × "
                    f"{sectors} sectors"
                )
            with loop.reproducible(self.threads):
                prediction = self.reranked(self.predict(net, heights), images, model)
                likest = [
                    (part @ memory.T).max(1) for part in torch.split(prediction.features, 512)
                ]
            likeness, row = (torch.cat(parts).numpy() for parts in zip(*likest, strict=True))
            scores = prediction.scores
            probability = softmax(scores, axis=1)
            novelty = self.novelties(scores, softness, likeness)
            places = np.argsort(-probability, axis=1, kind="stable")[:, :k]
            return Ranking(
                places.astype(np.int64),
                (1 - np.take_along_axis(probability, places, axis=1)).astype(np.float32),
                self.positions(place_xy[places], model["memory_xy_m"][row]),
                np.stack([*novelty.values()], axis=1).astype(np.float32),
                softmax(scores / softness, axis=1).max(axis=1).astype(np.float32),
                np.take_along_axis(prediction.heading_deg.numpy(), places, axis=1),
                tuple(novelty),
            )

        return localize

    def step(self, answer: Any, batch: Any) -> tuple[Tensor, Tensor, int]:
        """Mean loss of a batch, how many of its views are right, and of how many.

        Cross-entropy by default.
        """
        return loop.classify(answer, batch)

    def positions(
        self, places_m: NDArray[np.float64], likest_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """World positions (n, k, 2) of the answers.

        By default the mean position `places_m` (n, k, 2) of each place's views. `likest_m` (n, 2)
        is the position of the training view most like the query.
        """
        return places_m

    def embedded(self, net: Any, heights: Tensor) -> Tensor:
        """Inputs of the last layer for quantized heights (n, rings, sectors).

        At the precision of training.
        """
        torch_device = next(net.parameters()).device
        with loop.autocast(torch_device, self.precision):
            seen: Tensor = net.embed(self.images(heights.to(torch_device)))
            return seen.float()

    def images(self, heights: Tensor) -> Tensor:
        """Coloured images (n, channels, rings, sectors) in [0, 1] of quantized heights."""
        table = sent(torch.from_numpy(colours(self.colormap)), heights.device).float() / 255
        return table[heights.long()].permute(0, 3, 1, 2)

    def whole(self, logits: Tensor) -> Tensor:
        """The network's logits (n, …, places) for whole images."""
        return logits

    def filled(self, model: Model) -> nn.Module:
        """The network of a model."""
        net = self.network(len(model["place_xy_m"]), *(int(side) for side in model["image_shape"]))
        loop.fill(net, model)
        return net.to(device())

    def heights(self, images: NDArray[np.float32]) -> Tensor:
        """Quantized heights (n, rings, sectors) of those in metres."""
        return torch.from_numpy(quantize(images, self.h_min_m, self.h_max_m))
