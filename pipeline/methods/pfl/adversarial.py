"""Trains place features (METHODS 5.1): a game and images in; weights and curves of training out.

Beside the training stands its health: numbers that tell whether the game goes well.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Seed, Whole
from pipeline.matching.sequences import SequenceMethod
from pipeline.methods.pfl.game import Game
from pipeline.networks import loop
from pipeline.networks.lenet import sent

RIGHT = "held_out_accuracy"
"""The judge's number that says which round is best, where it gives one."""
SETTLED = 16
"""Batches of a round that the running statistics to localise by are taken from."""
BLACK = -1.0
"""Of a pixel as networks take them."""
Health = dict[str, float]
"""Numbers that tell how a training goes besides its losses, by name."""


def health(encoder: nn.Module, decoder: nn.Module, images: Tensor) -> Health:
    """Health of the networks on held-out images (n, 1, 64, 64), by name.

    The mean squared error of their reconstructions, and of a black image in their place, below
    which a reconstruction tells something; the codes' variance (mean over the dimensions) and their
    mean distance from each other, both near 0 in a collapse.
    """
    codes = encoder(images).float()
    numbers = (
        mse_loss(decoder(codes).float(), images),
        (images - BLACK).square().mean(),
        codes.var(0).mean(),
        torch.pdist(codes).mean(),
    )
    names = ("held_out_error", "black_error", "code_variance", "code_distance")
    return dict(zip(names, map(float, numbers), strict=True))


@torch.no_grad()
def settle(encoder: nn.Module, decoder: nn.Module, batches: Iterable[Tensor]) -> None:
    """Set the batch norms' running statistics from images (batch, 1, 64, 64) and reconstructions.

    Those of training mix both with the fakes of half a round, and a variance that is too small or
    too large by far looks like a collapse.
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
        layer.momentum = None  # a plain mean, for which a GPU is waited for at every batch
    for images in batches:
        decoder(encoder(images))
    for layer, momentum in zip(layers, momenta, strict=True):
        layer.momentum = momentum


def pixels(images: NDArray[np.uint8] | Tensor, torch_device: torch.device) -> Tensor:
    """Bird-views (n, 64, 64) as networks take them: (n, 1, 64, 64) in [−1, 1]."""
    return torch.as_tensor(images).to(torch_device)[:, None].float() / 127.5 - 1


@dataclass(frozen=True)
class Training(SequenceMethod):
    """Settings and rounds of the adversarial game."""

    view: str = "birdview"
    contrast_rows: int = 30
    width: Count = 64
    """Filters of the first convolution, with which every hidden layer scales."""
    code: Count = 512
    """Numbers in a code: 1 KB as they are stored."""
    epochs: Whole = 30
    """Passes over all headings of the training rows; 0 leaves the weights as they were drawn, which
    shows what matching alone does.

    Neither the paper nor its code says how many; BiGAN's authors make 400 over MNIST's 50,000
    images, and 30 over the 120,000 of an NCLT drive are 56,000 iterations.
    """
    batch: int = 64
    learning_rate: Positive = 0.0002
    schedule: loop.Schedule = "constant"
    """The authors' is constant; a short training needs the rate to fall at its end, and then
    `learning_rate` is the peak."""
    beta1: float = 0.5
    generator_steps: Count = 4
    """Turns of the generators in an iteration, on the same batch. The discriminators and the cycles
    have one, and so have the generators of an objective that sums their terms, the paper's."""
    kept: Literal["best", "last"] = "best"
    """Which round's weights: of the round that knew the most held-out places, of equals the last;
    or the last round's. `best` looks at places, so it is not fully unsupervised; `last`, the
    paper's, looks at none."""
    precision: loop.Precision = "auto"
    threads: Count = 2
    """Fixed, since the order of sums follows from it, and the weights from that."""
    seed: Seed = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.batch < 2:
            raise ConfigError(f"method.batch={self.batch}: expected 2 or more, for the batch norms")
        if not 0 <= self.beta1 < 1:
            raise ConfigError(f"method.beta1={self.beta1}: expected 0 or more, and less than 1")

    def play(
        self,
        game: Game,
        images: NDArray[np.uint8],
        judge: Callable[[Game], Health],
        rounds: int,
        iterations: int,
        progress: Progress,
    ) -> dict[str, NDArray[np.float64]]:
        """Train the game's networks on images (n, 64, 64); returns terms and judgements by round.

        Each term's mean and the judge's numbers. Each turn has an Adam of its own, as in the
        authors' code. The makers end with their weights of the round that is `kept`: no loss of
        such a game says which are best, and it swings to its end. Without epochs the judgement is
        of the weights as they are. The images stay on the networks' device. Every random draw of a
        round follows from the seed and the round's number, so a run that goes on from
        `progress.checkpoint` gives the weights of one that was never interrupted.
        """
        torch_device = next(game.parameters()).device
        optimizers = {}
        for turn in game.turns():
            weights = [weight for player in turn.players for weight in player.parameters()]
            optimizers[f"adam/{turn.name}"] = torch.optim.Adam(
                weights, self.learning_rate, (self.beta1, 0.999), fused=True
            )
        data = torch.from_numpy(images).to(torch_device)
        curves = dict[str, list[float]]()
        rounds_done = 0
        best_weights = _makers(game)
        if checkpoint := loop.resume(progress.checkpoint, game, optimizers):
            columns = loop.pop_prefixed(checkpoint, "curves/")
            curves = {name: column.tolist() for name, column in columns.items()}
            rounds_done = len(next(iter(curves.values())))
            best_weights = loop.pop_prefixed(checkpoint, loop.BEST)
        for number in progress.track(range(rounds_done, rounds), rounds - rounds_done, "train"):
            torch.manual_seed((self.seed << 20) + number)
            batches = self._batches(len(data), iterations).to(torch_device)

            def rate(iteration: int, number: int = number) -> float:
                done_share = (number + iteration / iterations) / rounds
                return self.learning_rate * loop.SCHEDULES[self.schedule](done_share)

            means = self._play_round(game, data, batches, optimizers, rate)
            settle(
                game.encoder,
                game.decoder,
                (pixels(data[rows], torch_device) for rows in batches[:SETTLED]),
            )
            game.eval()
            row = means | judge(game)
            for name, value in row.items():
                if not math.isfinite(value):
                    raise ConfigError(
                        f"training diverged: {name} in round {number + 1} is {value}; lower "
                        "method.learning_rate"
                    )
                curves.setdefault(name, []).append(value)
            if self.kept_round(curves) == number:
                best_weights = _makers(game)
            progress.note(epoch=number + 1, **row)
            if progress.checkpoint is not None:
                columns = {
                    f"curves/{name}": torch.tensor(column, dtype=torch.float64)
                    for name, column in curves.items()
                }
                columns |= {f"{loop.BEST}{name}": value for name, value in best_weights.items()}
                loop.keep(progress.checkpoint, game, optimizers, columns)
        game.load_state_dict(best_weights, strict=False)
        return {name: np.array(column) for name, column in curves.items()}

    def _batches(self, count: int, iterations: int) -> Tensor:
        """Rows (iteration, batch) of `count` images: one random order of all after the other."""
        passes = -(-iterations * self.batch // count)
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
        """Take all turns on each batch (iteration, row) of the images; returns each term's mean.

        `rate` gives the learning rate of the iteration of this number.
        """
        turns = game.turns()
        torch_device = data.device
        repeated_turns = [turn for turn in turns if turn.repeated] * self.generator_steps
        order = [*(turn for turn in turns if not turn.repeated), *repeated_turns]
        zero = torch.zeros((), device=torch_device)
        means: dict[str, Tensor] = {}
        game.train()
        for iteration, rows in enumerate(batches if self.epochs else ()):
            real_images = pixels(data[rows], torch_device)
            codes = sent(torch.randn(self.batch, self.code), torch_device)
            for turn in order:
                with loop.autocast(torch_device, self.precision):
                    terms = turn.terms(real_images, codes)
                loss = sum(terms.values(), zero)
                _move(optimizers[f"adam/{turn.name}"], rate(iteration), loss)
                times = len(batches) * (self.generator_steps if turn.repeated else 1)
                for name, term in terms.items():
                    means[name] = means.get(name, zero) + term.detach() / times
        return {name: float(value) for name, value in means.items()}

    def kept_round(self, curves: Mapping[str, Sequence[float] | NDArray[np.float64]]) -> int:
        """The round whose weights are kept, 0-based."""
        rounds = len(next(iter(curves.values())))
        right = np.asarray(
            curves[RIGHT] if self.kept == "best" and RIGHT in curves else [0] * rounds
        )
        return rounds - 1 - int(right[::-1].argmax())


def _makers(game: Game) -> dict[str, Tensor]:
    """The weights of encoder and decoder, as they are now."""
    return {
        name: weights.clone()
        for name, weights in game.state_dict().items()
        if name.startswith(("encoder.", "decoder."))
    }


def _move(optimizer: torch.optim.Optimizer, learning_rate: float, loss: Tensor) -> None:
    """Step the optimiser's own weights; the other players' gradients are not even computed."""
    optimizer.param_groups[0]["lr"] = learning_rate
    weights: list[Any] = optimizer.param_groups[0]["params"]
    optimizer.zero_grad(set_to_none=True)
    loss.backward(inputs=weights)  # type: ignore[no-untyped-call]
    optimizer.step()
