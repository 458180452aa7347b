"""SCI on a ring: places at headings as the classes of one softmax, so every answer tells where it looks (METHODS 8)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.errors import ConfigError
from pipeline.frames import yaw
from pipeline.matching.ranking import Rows
from pipeline.methods.sci_ring.ring import Ring
from pipeline.networks import loop
from pipeline.networks.circle import circular_mean_deg, neighbours, rolled
from pipeline.networks.classifier import Classifier, Kinds, Known, Look
from pipeline.networks.lenet import device

HEADING_SOFTNESS = 2.0
"""The first place's headings are weighed at this temperature: the mean of sharper chances leans to the nearest of them, as
held-out blocks of two simulated worlds showed."""
Batch = tuple[Tensor, Tensor, Tensor]
"""Images (b, channels, rings, sectors), their places (b,) and their yaw (b,) in headings, a fraction of which may be left."""


@dataclass(frozen=True)
class SciRing(Classifier):
    """Ours; neither paper's. Its view has columns that turn counter-clockwise, a number that 8 divides."""

    epochs: int = 400
    """In one each training view is shown once, turned at random: two are as long as one of two-way SCI."""
    yaw_noise_deg: float = 0.0
    """Standard deviation of what is added to the yaw of each training view, to study how well it must be known."""

    erased_deg: float = 0.0
    """A wedge of up to this width is emptied in each training view, as if what stood there were gone."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.erased_deg < 360:
            raise ConfigError(f"method.erased_deg={self.erased_deg}: expected 0 or more, and less than 360")
        if self.yaw_noise_deg < 0:
            raise ConfigError(f"method.yaw_noise_deg={self.yaw_noise_deg}: expected a number of at least 0")

    def network(self, places: int, rings: int, sectors: int) -> Ring:
        """Raises InputError where 8 does not divide the sectors."""
        return Ring(places, rings, sectors, self.channels, self.dropout, self.batch_norm_momentum)

    def batches(self, heights: Tensor, views: Rows, places: Tensor, trained: Tensor) -> tuple[loop.Batches[Batch], int]:
        """Every trained view once, in a new order, each turned by columns of its own and with a wedge of its own gone."""
        sectors, columns = heights.shape[2], self._columns(views, heights.shape[2])

        def epoch(order: torch.Generator) -> Iterator[Batch]:
            for chosen in torch.split(trained[torch.randperm(len(trained), generator=order)], self.batch):
                if len(chosen) > 1 or len(trained) == 1:  # a batch of one says nothing of the statistics
                    turns = torch.randint(sectors, (len(chosen),), generator=order)
                    turned = rolled(heights[chosen], turns)
                    if self.erased_deg:
                        first, width = torch.rand(2, len(chosen), 1, 1, generator=order) * sectors
                        behind = (torch.arange(sectors) - first) % sectors
                        turned = turned * (behind >= width * (self.erased_deg / 360))
                    yield (
                        self.images(turned),
                        places[chosen].to(device()),
                        (columns[chosen] - turns).to(device()) * (Ring.count(sectors) / sectors),
                    )

        return epoch, -(-len(trained) // self.batch)

    def _columns(self, views: Rows, sectors: int) -> Tensor:
        """The yaw (n,) of training views in columns, with the noise that is studied."""
        noise_deg = np.random.default_rng(self.seed).normal(0, self.yaw_noise_deg, len(views.world_T_anchor))
        return torch.from_numpy((np.rad2deg(yaw(views.world_T_anchor)) + noise_deg) * (sectors / 360)).float()

    def step(self, answer: Callable[[Tensor], Tensor], batch: Batch) -> tuple[Tensor, Tensor, int]:
        """Cross-entropy in nats over headings × places at once, and how often the likeliest place is right.

        The target is split linearly between the two headings nearest the true one.
        """
        images, classes, headings = batch
        logits = answer(images).float()
        chances = logits.flatten(1).log_softmax(1).view_as(logits)
        first, second, share = neighbours(headings, logits.shape[1])
        each = torch.arange(len(classes), device=classes.device)
        told = chances[each, first, classes].lerp(chances[each, second, classes], share)
        return -told.mean(), (logits.logsumexp(1).argmax(1) == classes).sum(), len(classes)

    @torch.inference_mode()
    def look(self, net: Ring, heights: Tensor, forgotten: Tensor | None = None) -> Look:
        """Logits summed over headings; the heading given the first place, and the features there, between the two next to it."""
        net.eval()
        where, found = device(), []
        for rows in torch.split(torch.arange(len(heights)), self.batch):
            embedded = self.embedded(net, heights[rows])
            logits = net.place(embedded)
            if forgotten is not None:
                logits = logits.masked_fill(forgotten[rows].to(where)[:, None], -torch.inf)
            scores, each = logits.logsumexp(1), torch.arange(len(rows))
            heading_deg = circular_mean_deg((logits[each, :, scores.argmax(1)] / HEADING_SOFTNESS).softmax(1))
            first, second, share = neighbours(heading_deg * (net.headings / 360), net.headings)
            features = embedded[each, first].lerp(embedded[each, second], share[:, None])
            found.append((scores, nn.functional.normalize(features), heading_deg))
        return Look(*(torch.cat(parts).cpu() for parts in zip(*found, strict=True)))

    @torch.inference_mode()
    def known(self, net: Ring, heights: Tensor, views: Rows, trained: Tensor) -> Known:
        """Every view, the held-out ones too, turned to look along +x."""
        net.eval()
        north = rolled(heights, self._columns(views, heights.shape[2]).round().long())
        parts = [self.embedded(net, part)[:, 0] for part in torch.split(north, self.batch)]
        return Known(nn.functional.normalize(torch.cat(parts)).cpu(), torch.arange(len(heights)))

    def positions(self, places_m: NDArray[np.float64], likest_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The first lies where the likest training view stands, whatever its place; the others at the mean of their views."""
        return np.concatenate([likest_m[:, None], places_m[:, 1:]], axis=1)

    def novelties(self, logits: NDArray[np.float64], softness: float, likeness: NDArray[np.float64]) -> Kinds:
        """The place's doubt times the features' comes first: new only where both say so.

        Of the two simulated worlds' held-out blocks neither factor alone had as much of both AUROC and area under the curve.
        """
        kinds = super().novelties(logits, softness, likeness)
        return {"combined": kinds["tempered_entropy"] * kinds["feature_distance"], **kinds}
