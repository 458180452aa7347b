"""Trains the networks of place features (METHODS 5.1): an adversarial game in several rounds.

In: a `Game` (an encoder, a decoder and their discriminators, with their losses) and images. Out:
the networks with the weights of the best round, and curves of all losses by round. A round is:

1. for each batch of images, take one step of the optimiser of each network in turn;
2. settle the batch norms' running statistics;
3. judge the encoder and decoder on validation images (`measure_health`, and how many places they
   recognise);
4. keep the weights if they are the best so far, and write a checkpoint.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Range, Seed, Whole
from pipeline.matching.sequences import SequenceMethod
from pipeline.methods.pfl.game import Game, Turn
from pipeline.networks import loop
from pipeline.networks.lenet import to_device

ACCURACY = "validation_accuracy"
"""The name of the judge's number by which the best round is chosen, if the judge returns it."""
SETTLING_BATCHES = 16
"""The number of batches from which the batch norms' running statistics are computed after a round.
"""
BLACK = -1.0
"""A black pixel; the networks' pixels are from −1 to 1."""
Health = dict[str, float]
"""Numbers by name that show, besides the losses, whether a training goes well."""


def measure_health(encoder: nn.Module, decoder: nn.Module, images: Tensor) -> Health:
    """Whether the networks work on validation images (n, 1, 64, 64), as numbers by name.

    - validation_error: mean squared error of the reconstructions.
    - black_error: mean squared error of a black image; a useful reconstruction has less.
    - code_variance (mean over the dimensions) and code_distance (mean distance of two codes): both
      are near 0 if the encoder has collapsed.
    """
    codes = encoder(images).float()
    return {
        "validation_error": float(mse_loss(decoder(codes).float(), images)),
        "black_error": float((images - BLACK).square().mean()),
        "code_variance": float(codes.var(0).mean()),
        "code_distance": float(torch.pdist(codes).mean()),
    }


@torch.no_grad()
def settle(encoder: nn.Module, decoder: nn.Module, batches: Iterable[Tensor]) -> None:
    """Set the batch norms' running statistics from images (batch, 1, 64, 64) and reconstructions.

    The statistics of training cannot be used, since they include generated images and outputs of
    earlier weights. With a variance that is far too small or too large, the networks seem to have
    collapsed.
    """
    layers = [
        layer
        for part in (encoder.train(), decoder.train())
        for layer in part.modules()
        if isinstance(layer, nn.BatchNorm2d)
    ]
    momenta = [layer.momentum for layer in layers]
    for layer in layers:
        layer.reset_running_stats()
        # None computes a plain mean over batches. It makes PyTorch synchronise the GPU at each
        # batch, so it is set only for these batches.
        layer.momentum = None
    for images in batches:
        decoder(encoder(images))
    for layer, momentum in zip(layers, momenta, strict=True):
        layer.momentum = momentum


def to_pixels(images: NDArray[np.uint8] | Tensor, torch_device: torch.device) -> Tensor:
    """Bird-views (n, 64, 64) as networks take them: (n, 1, 64, 64) in [−1, 1]."""
    grey = torch.as_tensor(images).to(torch_device)[:, None].float()  # from 0 to 255
    return grey / 127.5 - 1


@dataclass(frozen=True)
class AdversarialMethod(SequenceMethod):
    """Settings of the adversarial training, and its rounds."""

    view: str = "birdview"
    width: Count = 64
    """The number of filters of the first convolution; every hidden layer scales with it."""
    code: Count = 512
    """The length of a code. It is stored as float16, so 512 numbers take 1 KB."""
    epochs: Whole = 30
    """Passes over all headings of the training rows. With 0 the initial random weights are used,
    which shows what matching alone achieves. An iteration is one batch; all iterations of the
    epochs are divided into rounds of equal length, which need not be epochs
    (`FeatureMethod._rounds`).

    Neither the paper nor its code gives the number. BiGAN's authors use 400 epochs on MNIST's
    50,000 images; 30 epochs on the 120,000 images of an NCLT drive are 56,000 iterations.
    """
    batch: Annotated[int, Range(2, wording="2 or more, for the batch norms")] = 64
    """Images in a batch."""
    learning_rate: Positive = 0.0002
    schedule: loop.Schedule = "constant"
    """The authors' schedule is constant. A short training needs a rate that falls at its end; then
    `learning_rate` is the peak."""
    beta1: Annotated[float, Range(0, 1 - 1e-9, wording="0 or more, and less than 1")] = 0.5
    """Adam's first decay rate."""
    generator_steps: Count = 4
    """How often an iteration takes each `repeated` turn, the generators', on its batch. All other
    turns take one step: the discriminators, the cycles, and the generators of an objective that
    sums their terms, like the paper's."""
    kept: Literal["best", "last"] = "best"
    """The round whose weights are kept: the round that recognised the most validation places (of
    equal rounds the last), or the last round. `best` uses place labels, so it is not fully
    unsupervised; `last`, as in the paper, does not."""
    precision: loop.Precision = "auto"
    threads: Count = 2
    """The number of threads is a setting, since the order of sums and so the weights depend on it.
    """
    seed: Seed = 0

    def play(
        self,
        game: Game,
        images: NDArray[np.uint8],
        judge: Callable[[Game], Health],
        rounds: int,
        iterations: int,
        progress: Progress,
    ) -> dict[str, NDArray[np.float64]]:
        """Train the game's networks on images (n, 64, 64), in rounds of `iterations` batches each.

        Returns the mean of each loss term, and each number of the judge, by round. Afterwards the
        encoder and the decoder have the weights of the round that `kept` chooses: no loss of an
        adversarial game says which weights are best, and the losses oscillate until the end. With 0
        epochs nothing is trained, and the judge's numbers are those of the initial weights. Every
        random draw of a round follows from the seed and the round's number, so a run that continues
        from `progress.checkpoint` gives the same weights as a run without interruption.
        """
        torch_device = next(game.parameters()).device
        data = torch.from_numpy(images).to(torch_device)
        optimizers = self._optimizers(game)

        def play_round(number: int) -> Health:
            """Play the round with this number, and judge."""
            batches = self._batches(len(data), iterations).to(torch_device)

            def rate(iteration: int) -> float:
                """The learning rate of an iteration of this round."""
                done_share = (number + iteration / iterations) / rounds
                return self.learning_rate * loop.SCHEDULES[self.schedule](done_share)

            means = self._play_round(game, data, batches, optimizers, rate)
            settle(
                game.encoder,
                game.decoder,
                (to_pixels(data[rows], torch_device) for rows in batches[:SETTLING_BATCHES]),
            )
            game.eval()
            row = means | judge(game)
            _check_finite(row, number)
            progress.note(epoch=number + 1, **row)  # a bar counts rounds as epochs
            return row

        curves = loop.play_rounds(
            game,
            optimizers,
            play_round,
            self.kept_round,
            rounds,
            self.seed,
            progress,
            kept_parts=("encoder.", "decoder."),
        )
        return {name: np.array(column) for name, column in curves.items()}

    def _optimizers(self, game: Game) -> dict[str, torch.optim.Optimizer]:
        """An Adam optimiser for each turn, as in the authors' code, by its name in a checkpoint."""
        optimizers: dict[str, torch.optim.Optimizer] = {}
        for turn in game.turns():
            weights = [weight for player in turn.players for weight in player.parameters()]
            optimizers[_optimizer_name(turn)] = torch.optim.Adam(
                weights, self.learning_rate, (self.beta1, 0.999), fused=True
            )
        return optimizers

    def _batches(self, count: int, iterations: int) -> Tensor:
        """The rows (iteration, batch) of `count` images, in one random order after the other."""
        passes = -(-iterations * self.batch // count)  # rounded up
        rows = torch.cat([torch.randperm(count) for _ in range(passes)])
        return rows[: iterations * self.batch].view(iterations, self.batch)

    def _play_round(
        self,
        game: Game,
        data: Tensor,
        batches: Tensor,
        optimizers: Mapping[str, torch.optim.Optimizer],
        rate: Callable[[int], float],
    ) -> dict[str, float]:
        """Take all turns on each batch (iteration, row) of the images; returns each term's mean."""
        turns = game.turns()
        torch_device = data.device
        repeated_turns = [turn for turn in turns if turn.repeated] * self.generator_steps
        ordered_turns = [*(turn for turn in turns if not turn.repeated), *repeated_turns]
        zero = torch.zeros((), device=torch_device)
        means: dict[str, Tensor] = {}
        game.train()
        for iteration, rows in enumerate(batches if self.epochs else ()):
            real_images = to_pixels(data[rows], torch_device)
            codes = to_device(torch.randn(self.batch, self.code), torch_device)
            for turn in ordered_turns:
                with loop.autocast(torch_device, self.precision):
                    terms = turn.terms(real_images, codes)
                loss = sum(terms.values(), zero)
                _take_step(optimizers[_optimizer_name(turn)], rate(iteration), loss)
                step_count = len(batches) * (self.generator_steps if turn.repeated else 1)
                for name, term in terms.items():
                    means[name] = means.get(name, zero) + term.detach() / step_count
        return {name: float(value) for name, value in means.items()}

    def kept_round(self, curves: Mapping[str, Sequence[float] | NDArray[np.float64]]) -> int:
        """The index of the round whose weights are kept so far."""
        if self.kept == "last" or ACCURACY not in curves:
            return len(next(iter(curves.values()))) - 1
        return loop.last_of_highest(curves[ACCURACY])


def _check_finite(row: Mapping[str, float], number: int) -> None:
    """Raise ConfigError if a loss term or number of a round is not finite."""
    for name, value in row.items():
        if not math.isfinite(value):
            raise ConfigError(
                f"training diverged: {name} in round {number + 1} is {value}; lower "
                "method.learning_rate"
            )


def _optimizer_name(turn: Turn) -> str:
    """The name of a turn's optimiser in a checkpoint."""
    return f"adam/{turn.name}"


def _take_step(optimizer: torch.optim.Optimizer, learning_rate: float, loss: Tensor) -> None:
    """Take a step of an optimiser down a loss, with gradients of its own weights only."""
    optimizer.param_groups[0]["lr"] = learning_rate
    weights: list[Any] = optimizer.param_groups[0]["params"]
    optimizer.zero_grad(set_to_none=True)
    loss.backward(inputs=weights)  # type: ignore[no-untyped-call]
    optimizer.step()
