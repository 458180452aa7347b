"""SCI localisation: places as classes of a small CNN over Scan Context Images (Kim, Park and Kim,
RA-L 2019; METHODS 2).

The network is `LeNet`; settings, training and answers are those of `Classifier` and `Learner`,
which `sci_ring` shares. This module adds what only SCI has: training on N turned copies of each
view, and how the network's outputs become logits and features.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pipeline.core.errors import ConfigError
from pipeline.matching.ranking import Rows
from pipeline.networks import loop
from pipeline.networks.classifier import rolled
from pipeline.networks.evidence import Prediction
from pipeline.networks.learner import Learner
from pipeline.networks.lenet import LeNet, device


@dataclass(frozen=True)
class Sci(Learner):
    """The paper's network, trained on turned copies of each view."""

    architecture = LeNet
    n_way: int = 2
    """The number of copies of each training image, turned by 360°/n_way from one to the next; 2 in
    the authors' code, forward and reversed."""

    def batches(
        self, heights: Tensor, views: Rows, places: Tensor, trained: Tensor
    ) -> tuple[loop.Batches[tuple[Tensor, Tensor]], int]:
        """The batches of an epoch: every trained view at its `n_way` headings, shuffled.

        Raises ConfigError if n_way does not divide the number of sectors.
        """
        if self.n_way < 1 or heights.shape[2] % self.n_way:
            raise ConfigError(
                f"method.n_way={self.n_way}: must divide the {heights.shape[2]} sectors of the view"
            )
        copies = len(trained) * self.n_way
        heights, places, trained = (part.to(device()) for part in (heights, places, trained))

        def epoch(order: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
            shuffled = torch.randperm(copies, generator=order).to(device())
            for copy_numbers in torch.split(shuffled, self.batch):
                if len(copy_numbers) > 1 or copies == 1:  # batch norms need two images
                    yield (
                        self.images(self._turned(heights, trained, copy_numbers)),
                        places[trained[copy_numbers // self.n_way]],
                    )

        return epoch, -(-copies // self.batch)

    def _turned(self, heights: Tensor, trained: Tensor, copy_numbers: Tensor) -> Tensor:
        """Heights (m, rings, sectors): copy i is view i // n_way, turned by i % n_way steps."""
        turns = (copy_numbers % self.n_way) * (heights.shape[2] // self.n_way)
        return rolled(heights[trained[copy_numbers // self.n_way]], turns)

    @torch.inference_mode()
    def predict(self, net: LeNet, heights: Tensor, left_out: Tensor | None = None) -> Prediction:
        """Logits and features; the headings are NaN, since a class is a place at any heading."""
        net.eval()
        embedded = torch.cat(
            [self.embedded(net, part) for part in torch.split(heights, self.batch)]
        )
        logits = net.place_logits(embedded).cpu()
        if left_out is not None:
            logits = logits.masked_fill(left_out, -torch.inf)
        return Prediction(
            logits, nn.functional.normalize(embedded).cpu(), torch.full_like(logits, torch.nan)
        )

    def embed_training(
        self, net: LeNet, heights: Tensor, views: Rows, trained: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Every trained view at each of its `n_way` headings."""
        turned = self._turned(heights, trained, torch.arange(len(trained) * self.n_way))
        return self.predict(net, turned).features, trained.repeat_interleave(self.n_way)
