"""Localises by a network whose classes are places (METHODS 2): common to `sci` and `sci_ring`.

In: Scan Context Images (heights in rings × sectors around the robot). Out: a ranking of places by
their softmax, with a confidence, kinds of novelty and headings. `Classifier` has the settings and
the localizer; `learner` trains. A method adds its network, its batches, and how the network's
outputs become logits, features and headings.
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
    checked,
)
from pipeline.matching.novelties import novelties
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.networks import loop
from pipeline.networks.evidence import Prediction
from pipeline.networks.lenet import device, to_device
from pipeline.views.scan_context import colours, quantize

Kinds = dict[str, NDArray[np.float64]]
"""Kind of novelty to its values (n,); the first kind is the one in use."""
QUERIES_AT_ONCE = 512
"""How many queries are compared with all training views at a time, which bounds the memory."""


@dataclass(frozen=True)
@checked("method")
class Classifier(ABC):
    """Settings of training, and answers by softmax.

    `heights` below are heights quantized to 256 levels, in the view's rings × sectors.
    """

    architecture: ClassVar[type[nn.Module]]
    """The class of the network."""
    view: str = "scan_context_authors"
    colormap: Literal["jet", "grey"] = "jet"
    """The colormap from heights to the colours of an image."""
    h_min_m: float = 0.0
    h_max_m: float = 15.0
    """Heights are clipped to [h_min_m, h_max_m] before they are coloured."""
    epochs: Count = 200
    batch: Count = 64
    learning_rate: Positive = 0.002
    schedule: loop.Schedule = "one_cycle"
    """The authors' schedule is constant. A short training needs a rate that falls at its end."""
    dropout: Share = 0.7
    batch_norm_momentum: Share = 0.1
    """The authors' 0.01 needs some 500 steps to forget the first weights: more than a short
    training has."""
    precision: loop.Precision = "auto"
    """The arithmetic of training and answers; the last layer always answers in float32."""
    threads: Count = 2
    """The number of threads is a setting, since the order of sums and so the weights depend on it.
    """
    seed: Seed = 0
    validation_every_m: Positive = 40.0
    validation_length_m: Positive = 4.0
    """One block of this length in every `validation_every_m` of the training path is used for
    validation, to choose the epoch, the temperature and the threshold."""
    neighbour_m: NotNegative = 20.0
    """To simulate a novel place, a validation query ignores the places and training views nearer
    than this."""
    refit: Share = 0.0
    """After all choices on validation blocks, this last share of the schedule is run once more on
    all views."""
    incremental: SomeShare = 0.3
    """The last share of the schedule that is run to learn a further day."""
    replayed: Whole = 2
    """The number of views of each known place that are replayed with further days: the views with
    the highest loss."""
    distilled: NotNegative = 0.0
    """Weight of the distance to the earlier network's answers in the loss of further days."""

    def __post_init__(self) -> None:
        if not self.h_min_m < self.h_max_m:
            raise ConfigError(
                f"method.h_max_m={self.h_max_m}: expected more than method.h_min_m={self.h_min_m}"
            )

    def network(self, places: int, rings: int, sectors: int) -> nn.Module:
        """The network before training; raises InputError for images of an unsuitable size."""
        channels = len(colours(self.colormap)[0])
        return self.architecture(
            places, rings, sectors, channels, self.dropout, self.batch_norm_momentum
        )

    @abstractmethod
    def batches(
        self, heights: Tensor, views: Rows, places: Tensor, trained: Tensor
    ) -> tuple[loop.Batches[Any], int]:
        """A function that draws the batches of an epoch over the rows `trained` (m,); and their
        number."""

    @abstractmethod
    def predict(self, net: Any, heights: Tensor, left_out: Tensor | None = None) -> Prediction:
        """The network's outputs for heights (n, rings, sectors).

        The mask `left_out` (n, places) gives the places whose logit is set to −∞; None leaves out
        no place.
        """

    @abstractmethod
    def embed_training(
        self, net: Any, heights: Tensor, views: Rows, trained: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Features (m, 64) of training views, of length 1, and the row (m,) of each view.

        By these features the training view that is most similar to a query is found.
        """

    def remembered(
        self, images: NDArray[np.float32], views: Rows, places: NDArray[np.int64], trained: Tensor
    ) -> Model:
        """The arrays of the trained views that the model keeps for `reranked`; by default none.

        `images` are their heights (n, rings, sectors) in metres.
        """
        return {}

    def reranked(
        self, prediction: Prediction, images: NDArray[np.float32], model: Model
    ) -> Prediction:
        """The outputs, changed by comparing the queries with the remembered views.

        `images` are the queries' heights (n, rings, sectors) in metres. By default nothing changes.
        """
        return prediction

    def novelties(
        self, logits: NDArray[np.float64], temperature: float, max_cosine: NDArray[np.float64]
    ) -> Kinds:
        """Kinds of novelty of queries, the one in use first.

        They follow from the logits (n, places), the calibrated temperature, and `max_cosine` (n,),
        the largest cosine between the feature of a query and those of the training views.
        """
        return novelties(logits, temperature, max_cosine)

    def localizer(self, model: Model) -> Localizer:
        """Rank the k places of highest softmax; the cost of each is 1 − its softmax."""
        place_xy = model["place_xy_m"]
        temperature = float(model["temperature"])
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
            # The network's outputs, and the most similar training view of each query.
            with loop.reproducible(self.threads):
                prediction = self.reranked(self.predict(net, heights), images, model)
                maxima = [
                    (part @ memory.T).max(1)
                    for part in torch.split(prediction.features, QUERIES_AT_ONCE)
                ]
            max_cosine, most_similar_row = (
                torch.cat(parts).numpy() for parts in zip(*maxima, strict=True)
            )
            # The places with the highest softmax.
            logits = prediction.float64_logits
            probability = softmax(logits, axis=1)
            places = np.argsort(-probability, axis=1, kind="stable")[:, :k]
            costs = 1 - np.take_along_axis(probability, places, axis=1)
            # Novelty and confidence at the temperature.
            novelty = self.novelties(logits, temperature, max_cosine)
            confidence = softmax(logits / temperature, axis=1).max(axis=1)
            return Ranking(
                places=places.astype(np.int64),
                costs=costs.astype(np.float32),
                xy_m=self.positions(place_xy[places], model["memory_xy_m"][most_similar_row]),
                novelty=np.stack([*novelty.values()], axis=1).astype(np.float32),
                confidence=confidence.astype(np.float32),
                heading_deg=np.take_along_axis(prediction.heading_deg.numpy(), places, axis=1),
                kinds=tuple(novelty),
            )

        return localize

    def step(self, answer: Any, batch: Any) -> tuple[Tensor, Tensor, int]:
        """Mean loss of a batch, the number of its views that are answered right, and of all views.

        By default the loss is the cross-entropy.
        """
        return loop.classify(answer, batch)

    def positions(
        self, places_m: NDArray[np.float64], most_similar_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """World positions (n, k, 2) in metres of the answers.

        By default they are `places_m` (n, k, 2), the mean positions of each place's views.
        `most_similar_m` (n, 2) are the positions of the queries' most similar training views.
        """
        return places_m

    def embedded(self, net: Any, heights: Tensor) -> Tensor:
        """The inputs of the network's last layer for heights (n, rings, sectors)."""
        torch_device = next(net.parameters()).device
        with loop.autocast(torch_device, self.precision):
            embedded: Tensor = net.embed(self.images(heights.to(torch_device)))
            return embedded.float()

    def images(self, heights: Tensor) -> Tensor:
        """Coloured images (n, channels, rings, sectors) in [0, 1] of heights."""
        table = to_device(torch.from_numpy(colours(self.colormap)), heights.device).float() / 255
        return table[heights.long()].permute(0, 3, 1, 2)

    def whole(self, logits: Tensor) -> Tensor:
        """The logits (n, …, places) for whole images, if the network also answers for parts."""
        return logits

    def filled(self, model: Model) -> nn.Module:
        """The network of a model."""
        net = self.network(len(model["place_xy_m"]), *(int(side) for side in model["image_shape"]))
        loop.fill(net, model)
        return net.to(device())

    def heights(self, images: NDArray[np.float32]) -> Tensor:
        """Heights (n, rings, sectors), quantized from metres."""
        return torch.from_numpy(quantize(images, self.h_min_m, self.h_max_m))


def rolled(heights: Tensor, turns: Tensor) -> Tensor:
    """Heights (n, rings, sectors), each rolled by its own number of sectors, `turns` (n,)."""
    turns = turns.to(heights.device)
    sectors = torch.arange(heights.shape[2], device=heights.device) - turns[:, None]
    sectors %= heights.shape[2]
    return heights.gather(2, sectors[:, None].expand_as(heights))
