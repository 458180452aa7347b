"""The training loop of all networks: `play_rounds`, and `fit` for all but adversarial networks.

In: a network, and functions that draw the batches of an epoch, compute the loss of a batch, and
judge the network on validation rows. Out: the network with its best weights, and the curves of
training. After an interruption it continues from a checkpoint, and ends with the same weights.

The parts of the loop are here too, for other trainings: fixed random draws, the arithmetic of a
device, storing and loading weights, schedules of the learning rate, and checkpoints.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.progress import Progress
from pipeline.networks.lenet import device
from pipeline.networks.plain import NET

Net = TypeVar("Net", bound=nn.Module)
Batch = TypeVar("Batch")
Batches = Callable[[torch.Generator], Iterator[Batch]]
"""Draws the batches of an epoch; all random draws follow from the generator."""
Step = Callable[[Callable[..., Tensor], Batch], tuple[Tensor, Tensor, int]]
"""Computes, from a network and a batch, the mean loss of the answers, the number of right answers,
and the number of all answers."""
Judge = Callable[[Any], tuple[float, float]]
"""Computes loss and accuracy of a network on validation rows."""
Schedule = Literal["one_cycle", "stepped", "constant"]
Precision = Literal["auto", "bf16", "f32"]
BEST = "best/"
CURVE = "curves/"
"""Prefixes in a checkpoint: of the best weights so far, and of the curves. The prefix of the
present weights is NET."""
Curves = dict[str, list[float]]
"""Numbers of a training by name, one per round."""
CURVES = ("loss", "accuracy", "validation_loss", "validation_accuracy")
"""The numbers that are recorded for each epoch."""


@contextmanager
def reproducible(threads: int) -> Iterator[None]:
    """Run a block with a fixed number of threads, and a random state of its own.

    The number of threads is fixed since sums depend on how the work is split. Afterwards the
    caller's number of threads and random state are restored. On a GPU random draws are
    reproducible, but sums only up to the order of their terms.
    """
    callers_threads = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        gpus = [torch.cuda.current_device()] if torch.cuda.is_available() else []
        with torch.random.fork_rng(gpus):  # only the GPU in use, or torch warns if there are more
            yield
    finally:
        torch.set_num_threads(callers_threads)


def dtype(torch_device: torch.device, precision: Precision) -> torch.dtype:
    """The number type for `precision`: bfloat16 or float32.

    `auto` means bfloat16 on any GPU, and on processors with instructions for it.
    """
    if precision == "auto":
        is_fast = torch_device.type != "cpu" or torch.ops.mkldnn._is_mkldnn_bf16_supported()
        return torch.bfloat16 if is_fast else torch.float32
    return torch.bfloat16 if precision == "bf16" else torch.float32


def arithmetic() -> str:
    """The default arithmetic of networks on this machine: `bfloat16` or `float32`."""
    return str(dtype(device(), "auto")).removeprefix("torch.")


def autocast(torch_device: torch.device, precision: Precision) -> torch.autocast:
    """A context in which torch computes in the type of `precision`."""
    return torch.autocast(
        torch_device.type, torch.bfloat16, enabled=dtype(torch_device, precision) == torch.bfloat16
    )


def cast(net: nn.Module, torch_device: torch.device, precision: Precision) -> None:
    """Convert the convolutions' kernels to the type of `precision`, for inference only.

    The answers have the same bits as with `autocast`, which would convert the kernels each time.
    """
    for module in net.modules():
        if isinstance(module, nn.Conv2d):
            module.to(dtype(torch_device, precision))


def arrays(net: nn.Module, prefix: str = NET) -> dict[str, NDArray[Any]]:
    """A network's weights as arrays of a model, with a prefix before their names."""
    return {
        f"{prefix}{name}": value.cpu().contiguous().numpy()
        for name, value in net.state_dict().items()
    }


def tensors(model: Mapping[str, NDArray[Any]], prefix: str = NET) -> dict[str, Tensor]:
    """The weights of a network from the arrays of a model, without the prefix."""
    return {
        name.removeprefix(prefix): torch.from_numpy(array.copy())
        for name, array in model.items()
        if name.startswith(prefix)
    }


def fill(
    net: nn.Module, model: Mapping[str, NDArray[Any]], prefix: str = NET, assign: bool = False
) -> None:
    """Load a model's weights into a network.

    Raises ArtifactError if they do not fit the network.
    """
    try:
        net.load_state_dict(tensors(model, prefix), assign=assign)
    except RuntimeError:
        raise ArtifactError(
            f"the model's weights are not those of a {type(net).__name__}: train it again"
        ) from None


def classify(
    net: Callable[[Tensor], Tensor], batch: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor, int]:
    """The step (`Step`) of a classifier, for a batch of images (n, …) and their classes (n,).

    The loss is the cross-entropy in nats of the network's logits (n, classes).
    """
    images, classes = batch
    logits = net(images)
    loss = nn.functional.cross_entropy(logits.float(), classes)
    return loss, (logits.argmax(1) == classes).sum(), len(classes)


def fit(
    net: Net,
    batches: Batches[Batch],
    judge: Judge | None,
    *,
    epochs: int,
    steps: int,
    learning_rate: float,
    schedule: Schedule,
    precision: Precision,
    seed: int,
    progress: Progress,
    step: Step[Any] = classify,
    fused: bool = False,
    since: float = 0.0,
) -> dict[str, NDArray[Any]]:
    """Train `net` with Adam on the loss of `step`, and leave the weights of the best epoch in it.

    The best epoch has the highest validation accuracy by `judge`; of equal epochs it is the last,
    and without a judge it is the last epoch. Returns arrays as a model stores them: `best_epoch`,
    counted from 0, and `curves/` (epoch,) for each of CURVES.

    An epoch has `steps` batches. `learning_rate` is the peak of the schedule. Training starts at
    the share `since` of the schedule, and ends with it. `fused` Adam rounds differently, but is
    much faster for a network of many numbers.
    """
    torch_device = next(net.parameters()).device
    fused = fused or torch_device.type == "cuda"
    optimizer = torch.optim.Adam(net.parameters(), learning_rate, eps=1e-7, fused=fused or None)

    def answer(*inputs: Any) -> Tensor:
        """The network's answers in the type of `precision`."""
        with autocast(torch_device, precision):
            answers: Tensor = net(*inputs)
            return answers

    def play_epoch(epoch: int) -> dict[str, float]:
        """Train for an epoch, and judge."""

        def rate(number: int) -> float:
            """The learning rate of a batch of this epoch, by its number."""
            done_share = since + (1 - since) * (epoch + number / steps) / epochs
            return learning_rate * SCHEDULES[schedule](done_share)

        order = torch.Generator().manual_seed(torch.initial_seed())
        net.train()
        loss, accuracy = _train_epoch(optimizer, batches(order), step, answer, rate, torch_device)
        if not math.isfinite(loss):
            raise ConfigError(
                f"training diverged: its loss in epoch {epoch + 1} is {loss}; lower "
                "method.learning_rate"
            )
        validation_loss, validation_accuracy = judge(net) if judge else (math.nan, 0.0)
        validation = {"validation": validation_accuracy} if judge else {}
        progress.note(epoch=epoch + 1, loss=loss, accuracy=accuracy, **validation)
        return dict(
            zip(CURVES, (loss, accuracy, validation_loss, validation_accuracy), strict=True)
        )

    activity = "train" if judge else "refit"
    curves = play_rounds(
        net, {"adam": optimizer}, play_epoch, _most_accurate, epochs, seed, progress, activity
    )
    columns = {f"curves/{name}": np.array(column) for name, column in curves.items()}
    return {"best_epoch": np.array(_most_accurate(curves)), **columns}


def play_rounds(
    net: nn.Module,
    optimizers: Mapping[str, torch.optim.Optimizer],
    play: Callable[[int], Mapping[str, float]],
    kept_round: Callable[[Curves], int],
    rounds: int,
    seed: int,
    progress: Progress,
    activity: str = "train",
    kept_parts: tuple[str, ...] = ("",),
) -> Curves:
    """Train a network in rounds, and leave the weights of the chosen round in it.

    `play` trains for a round, given by its number from 0, and returns numbers by name; over all
    rounds they are the curves that are returned. `kept_round` chooses a round from the curves so
    far; of its weights, those whose names begin with one of `kept_parts` are kept. Every random
    draw of a round follows from the seed and the round's number, so a run that continues from
    `progress.checkpoint` gives the same weights as a run without interruption.
    """

    def weights() -> dict[str, Tensor]:
        """A copy of the present weights of `kept_parts`."""
        return {
            name: value.clone()
            for name, value in net.state_dict().items()
            if name.startswith(kept_parts)
        }

    curves: Curves = {}
    best_weights = weights()
    rounds_done = 0
    if checkpoint := resume(progress.checkpoint, net, optimizers):
        columns = pop_prefixed(checkpoint, CURVE)
        curves = {name: column.tolist() for name, column in columns.items()}
        rounds_done = len(next(iter(curves.values())))
        best_weights = pop_prefixed(checkpoint, BEST)
    for number in progress.track(range(rounds_done, rounds), rounds - rounds_done, activity):
        # Trainings of two seeds share no draw: none has 2²⁰ rounds.
        torch.manual_seed((seed << 20) + number)
        for name, value in play(number).items():
            curves.setdefault(name, []).append(value)
        if kept_round(curves) == number:
            best_weights = weights()
        if progress.checkpoint is not None:
            further_tensors = {f"{BEST}{name}": value for name, value in best_weights.items()}
            for name, column in curves.items():
                further_tensors[f"{CURVE}{name}"] = torch.tensor(column, dtype=torch.float64)
            keep(progress.checkpoint, net, optimizers, further_tensors)
    net.load_state_dict(best_weights, strict=False)  # without the parts that are not kept
    return curves


def _most_accurate(curves: Curves) -> int:
    """The epoch of the highest accuracy, since the loss may rise while the ranking improves."""
    return last_of_highest(curves["validation_accuracy"])


def last_of_highest(accuracies: Sequence[float] | NDArray[np.float64]) -> int:
    """The index of the highest accuracy; of equal accuracies the last."""
    return len(accuracies) - 1 - int(np.asarray(accuracies)[::-1].argmax())


def _train_epoch(
    optimizer: torch.optim.Optimizer,
    batches: Iterator[Any],
    step: Step[Any],
    answer: Callable[..., Tensor],
    rate: Callable[[int], float],
    torch_device: torch.device,
) -> tuple[float, float]:
    """Take one step down the loss of each batch; returns mean loss and accuracy of the epoch."""
    # The sums stay on the device, since reading them waits for it.
    loss_sum = torch.zeros((), device=torch_device)
    right_count = torch.zeros((), device=torch_device)
    answer_count = 0
    for number, batch in enumerate(batches):
        optimizer.param_groups[0]["lr"] = rate(number)
        loss, right, count = step(answer, batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        loss_sum += loss.detach() * count
        right_count += right
        answer_count += count
    return float(loss_sum) / answer_count, float(right_count) / answer_count


def one_cycle(done_share: float) -> float:
    """The learning rate at a share of the training, as a share of its peak.

    It rises as a cosine from 4 % to 1 at 30 % of the training, then falls to nearly 0 (Smith and
    Topin, 2018): a short training needs a rate that falls at its end.
    """
    if done_share < 0.3:
        return 0.52 - 0.48 * math.cos(math.pi * done_share / 0.3)  # from .52 − .48 to .52 + .48
    return 0.5 + 0.5 * math.cos(math.pi * (done_share - 0.3) / 0.7)


SCHEDULES: Mapping[Schedule, Callable[[float], float]] = {
    "one_cycle": one_cycle,
    # the schedule of PointNetVLAD's authors, for 20 epochs
    "stepped": lambda done_share: 0.9 ** int(4 * done_share),
    "constant": lambda done_share: 1.0,
}
"""Functions from the share of the training that is done to the learning rate, as a share of its
peak."""


def keep(
    path: Path,
    net: nn.Module,
    optimizers: Mapping[str, torch.optim.Optimizer],
    further_tensors: Mapping[str, Tensor],
) -> None:
    """Write a checkpoint: the network, the optimisers' moments, and further tensors."""
    checkpoint = {f"{NET}{name}": value for name, value in net.state_dict().items()} | dict(
        further_tensors
    )
    for optimizer_name, optimizer in optimizers.items():
        for index, state in optimizer.state_dict()["state"].items():
            checkpoint |= {
                f"{optimizer_name}/{index}/{name}": value for name, value in state.items()
            }
    with store.replace(path) as scratch:
        save_file({name: value.contiguous() for name, value in checkpoint.items()}, scratch)


def resume(
    path: Path | None, net: nn.Module, optimizers: Mapping[str, torch.optim.Optimizer]
) -> dict[str, Tensor]:
    """Load a checkpoint into a network and its optimisers, and return its further tensors.

    They are empty if there is no file. Raises ArtifactError for a file that is cut off, or that
    belongs to another training.
    """
    if path is None or not path.is_file():
        return {}
    try:
        checkpoint: dict[str, Tensor] = load_file(path, device=str(next(net.parameters()).device))
        if not any(name.startswith(CURVE) for name in checkpoint):
            raise KeyError(CURVE)
        net.load_state_dict(pop_prefixed(checkpoint, NET))
        for optimizer_name, optimizer in optimizers.items():
            state: dict[int, dict[str, Tensor]] = {}
            weights: list[Tensor] = [
                weight for group in optimizer.param_groups for weight in group["params"]
            ]
            for name, value in pop_prefixed(checkpoint, f"{optimizer_name}/").items():
                index, _, field = name.partition("/")
                # A moment gets the strides of its weight, on which rounding depends.
                moment = torch.empty_like(weights[int(index)])
                state.setdefault(int(index), {})[field] = (
                    value.cpu() if field == "step" else moment.copy_(value)
                )
            optimizer.load_state_dict(
                {"state": state, "param_groups": optimizer.state_dict()["param_groups"]}
            )
    except (SafetensorError, KeyError, RuntimeError) as error:
        raise ArtifactError(
            f"{path}: not a whole checkpoint of this training ({error}); remove it"
        ) from None
    return checkpoint


def pop_prefixed(tensors_by_name: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """Remove the tensors whose names have a prefix, and return them by the names without it."""
    return {
        name.removeprefix(prefix): tensors_by_name.pop(name)
        for name in list(tensors_by_name)
        if name.startswith(prefix)
    }
