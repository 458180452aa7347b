"""Training that plays the adversarial game of place features, and what tells how it goes (METHODS 5.1)."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from pipeline.errors import ConfigError
from pipeline.methods.pfl.game import Game
from pipeline.networks import loop
from pipeline.running.progress import Progress

RIGHT = "held_out_accuracy"
"""The judge's number that says which round is best, where it gives one."""
SETTLED = 16
"""Batches of a round that the running statistics to localise by are taken from."""
Health = dict[str, float]
"""Numbers that tell how a training goes besides its losses."""


def health(encoder: nn.Module, decoder: nn.Module, images: Tensor) -> Health:
    """What held-out images (n, 1, 64, 64) show: the mean squared error of their reconstructions, the codes' variance (mean over
    the dimensions) and their mean distance from each other; the last two near 0 are a collapse."""
    codes = encoder(images).float()
    error = mse_loss(decoder(codes).float(), images)
    return {
        "held_out_error": float(error),
        "code_variance": float(codes.var(0).mean()),
        "code_distance": float(torch.pdist(codes).mean()),
    }


@torch.no_grad()
def settle(encoder: nn.Module, decoder: nn.Module, batches: Iterable[Tensor]) -> None:
    """Give the batch norms the running statistics of images (batch, 1, 64, 64) and their reconstructions: those of training mix
    both with the fakes of half a round, and a variance that is too small or too large by far looks like a collapse."""
    for part in (encoder, decoder):
        part.train()
        for layer in part.modules():
            if isinstance(layer, nn.BatchNorm2d):
                layer.reset_running_stats()
                layer.momentum = None  # a plain mean
    for images in batches:
        decoder(encoder(images))


def pixels(images: NDArray[np.uint8] | Tensor, where: torch.device) -> Tensor:
    """Bird-views (n, 64, 64) as networks take them: (n, 1, 64, 64) in [−1, 1]."""
    return torch.as_tensor(images).to(where)[:, None].float() / 127.5 - 1


def play(
    game: Game,
    images: NDArray[np.uint8],
    judge: Callable[[Game], Health],
    *,
    code: int,
    rounds: int,
    iterations: int,
    batch: int,
    learning_rate: float,
    schedule: loop.Schedule,
    beta1: float,
    generator_steps: int,
    precision: Literal["auto", "bf16", "f32"],
    seed: int,
    progress: Progress,
) -> dict[str, NDArray[np.float64]]:
    """Train the game's networks on images (n, 64, 64); returns every term's mean in each round, and the judge's numbers after it.

    Each turn has an Adam of its own, as in the authors' code. The makers end with their weights of the round that knew the most
    held-out places, of equals the last: no loss of such a game says which are best, and it swings to its end. Every random draw
    of a round follows from the seed and the round's number, so a run that goes on from `progress.checkpoint` gives the weights of
    one that was never interrupted.
    """
    where, turns = next(game.parameters()).device, game.turns()
    moves = [
        torch.optim.Adam(
            [weight for player in turn.players for weight in player.parameters()], learning_rate, (beta1, 0.999), fused=True
        )
        for turn in turns
    ]
    optimizers = {f"adam/{turn.name}": move for turn, move in zip(turns, moves, strict=True)}
    share = loop.SCHEDULES[schedule]
    data, curves = torch.from_numpy(images), dict[str, list[float]]()
    done, best = 0, _makers(game)
    if progress.checkpoint is not None and progress.checkpoint.is_file():
        with loop.whole(progress.checkpoint):
            kept = loop.resume(progress.checkpoint, game, optimizers)
            done = len(kept["curves/joint_generator"])
        curves = {name.removeprefix("curves/"): value.tolist() for name, value in kept.items() if name.startswith("curves/")}
        best = {name.removeprefix(loop.BEST): value for name, value in kept.items() if name.startswith(loop.BEST)}
    for number in progress.track(range(done, rounds), rounds - done, "train"):
        torch.manual_seed((seed << 20) + number)
        passes = -(-iterations * batch // len(data))
        order = torch.cat([torch.randperm(len(data)) for _ in range(passes)])[: iterations * batch].view(iterations, batch)
        sums: dict[str, Tensor] = {}
        game.train()
        for step, rows in enumerate(order):
            rate = learning_rate * share((number + step / iterations) / rounds)
            seen, codes = pixels(data[rows], where), torch.randn(batch, code).to(where)
            for turn in [*(t for t in turns if not t.repeated), *[t for t in turns if t.repeated] * generator_steps]:
                with loop.autocast(where, precision):
                    terms = turn.terms(seen, codes)
                _move(optimizers[f"adam/{turn.name}"], rate, sum(terms.values(), torch.zeros((), device=where)))
                for name, term in terms.items():
                    times = iterations * (generator_steps if turn.repeated else 1)
                    sums[name] = sums.get(name, torch.zeros((), device=where)) + term.detach() / times
        settle(game.encoder, game.decoder, (pixels(data[rows], where) for rows in order[:SETTLED]))
        game.eval()
        row = {name: float(value) for name, value in sums.items()} | judge(game)
        for name, value in row.items():
            if not math.isfinite(value):
                raise ConfigError(f"training diverged: {name} in round {number + 1} is {value}; lower method.learning_rate")
            curves.setdefault(name, []).append(value)
        if best_round(curves) == number:
            best = _makers(game)
        progress.note(epoch=number + 1, **row)
        if progress.checkpoint is not None:
            columns = {f"curves/{name}": torch.tensor(column, dtype=torch.float64) for name, column in curves.items()}
            columns |= {f"{loop.BEST}{name}": value for name, value in best.items()}
            loop.keep(progress.checkpoint, game, optimizers, columns)
    game.load_state_dict(best, strict=False)
    return {name: np.array(column) for name, column in curves.items()}


def best_round(curves: Mapping[str, Sequence[float] | NDArray[np.float64]]) -> int:
    """The round whose weights are kept, 0-based."""
    right = np.asarray(curves.get(RIGHT, np.zeros(len(next(iter(curves.values()))))))
    return len(right) - 1 - int(right[::-1].argmax())


def _makers(game: Game) -> dict[str, Tensor]:
    """The weights of encoder and decoder, as they are now."""
    own = ("encoder.", "decoder.")
    return {name: value.clone() for name, value in game.state_dict().items() if name.startswith(own)}


def _move(optimizer: torch.optim.Optimizer, learning_rate: float, loss: Tensor) -> None:
    """A step of those whom the optimiser holds; the others' gradients are not even computed."""
    optimizer.param_groups[0]["lr"] = learning_rate
    weights: list[Any] = optimizer.param_groups[0]["params"]
    optimizer.zero_grad(set_to_none=True)
    loss.backward(inputs=weights)  # type: ignore[no-untyped-call]
    optimizer.step()
