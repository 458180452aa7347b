"""Tests of the training loop: it is reproducible, goes on after an interruption, and keeps the best
epoch by validation rows."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.networks.loop import CURVES, arrays, fit, one_cycle, reproducible
from tests.interrupted import PowerCut, same

IMAGES = torch.randn(24, 6, generator=torch.Generator().manual_seed(1))
CLASSES = (IMAGES[:, 0] > 0).long()


def network() -> nn.Module:
    torch.manual_seed(5)
    return nn.Sequential(
        nn.Linear(6, 8), nn.BatchNorm1d(8), nn.ReLU(), nn.Dropout(0.3), nn.Linear(8, 2)
    )


def batches(order: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
    for rows in torch.randperm(24, generator=order).split(8):
        yield IMAGES[rows], CLASSES[rows]


def judge(net: nn.Module) -> tuple[float, float]:
    net.eval()
    with torch.inference_mode():
        logits = net(IMAGES)
        return float(nn.functional.cross_entropy(logits, CLASSES)), float(
            (logits.argmax(1) == CLASSES).float().mean()
        )


HOW: dict[str, Any] = {"learning_rate": 0.02, "schedule": "constant", "precision": "f32", "seed": 3}


def train(
    epochs: int = 6,
    progress: Progress | None = None,
    accuracies: list[float] | None = None,
    **settings: int,
) -> dict[str, np.ndarray]:
    """Train; `accuracies` are what the judge is to say, epoch by epoch.

    Weights, curves and the best epoch.
    """
    said = iter(accuracies or [])
    net = network()
    judged = (lambda net: (1.0, next(said))) if accuracies else judge
    with reproducible(1):
        found = fit(
            net,
            batches,
            judged,
            epochs=epochs,
            steps=3,
            progress=progress or Progress(),
            **(HOW | settings),
        )
    return found | arrays(net)


def test_the_loss_falls_and_the_classes_are_learned() -> None:
    result = train(epochs=40)
    assert all(len(result[f"curves/{name}"]) == 40 for name in CURVES)
    assert result["curves/loss"][-1] < 0.5 * result["curves/loss"][0]
    assert result["curves/validation_accuracy"][result["best_epoch"]] > 0.9


def test_the_same_seed_gives_the_same_weights_whatever_the_callers_random_numbers_which_are_left_alone() -> (
    None
):
    assert not same(train(), train(seed=4))
    threads = torch.get_num_threads()
    state = torch.get_rng_state()
    first = train()
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(99)
    torch.rand(7)
    assert same(first, train())


@pytest.mark.parametrize("best", [0, 2])
def test_the_epoch_of_the_highest_validation_accuracy_is_kept(best: int) -> None:
    # What an epoch ends with does not depend on the judge: the weights kept are those of a run that
    # stops there.
    accuracies = [0.5] * 5
    accuracies[best] = 0.6
    result = train(epochs=5, accuracies=accuracies)
    assert result["best_epoch"] == best
    stopped = train(epochs=best + 1, accuracies=accuracies)
    assert all(
        np.array_equal(result[name], stopped[name]) for name in stopped if name.startswith("net/")
    )


def test_of_equally_good_epochs_the_last_is_kept() -> None:
    assert train(epochs=3, accuracies=[0.5, 0.6, 0.6])["best_epoch"] == 2


@pytest.mark.parametrize("at", [1, 4])
def test_an_interrupted_run_goes_on_to_the_same_weights(tmp_path: Path, at: int) -> None:
    whole = train()
    cut = PowerCut(checkpoint=tmp_path / "half", at=at)
    with pytest.raises(KeyboardInterrupt):
        train(progress=cut)
    assert cut.checkpoint is not None
    assert cut.checkpoint.exists() == (at > 1)  # of the first epoch nothing was kept yet
    assert same(train(progress=replace(cut, at=-1)), whole)


def test_a_run_interrupted_three_times_and_its_best_epoch_long_past_is_the_same(
    tmp_path: Path,
) -> None:
    accuracies = [0.5, 0.9, 0.6, 0.6, 0.7, 0.8]
    whole = train(accuracies=accuracies)
    for at, kept in (
        (3, 0),
        (4, 2),
        (6, 3),
    ):  # each run goes on after the epochs that the one before it kept
        with pytest.raises(KeyboardInterrupt):
            train(
                progress=PowerCut(checkpoint=tmp_path / "half", at=at), accuracies=accuracies[kept:]
            )
    resumed = train(progress=Progress(checkpoint=tmp_path / "half"), accuracies=accuracies[5:])
    assert resumed["best_epoch"] == 1
    assert same(resumed, whole)


def test_a_finished_run_is_not_trained_again(tmp_path: Path) -> None:
    progress = Progress(checkpoint=tmp_path / "done")
    first = train(progress=progress)
    assert same(train(progress=PowerCut(checkpoint=progress.checkpoint, at=6)), first)


def test_a_loss_that_is_no_number_stops_the_run() -> None:
    def broken(order: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
        yield IMAGES * float("nan"), CLASSES

    with reproducible(1), pytest.raises(ConfigError, match="epoch 1"):
        fit(network(), broken, judge, epochs=1, steps=1, progress=Progress(), **HOW)


def test_one_cycle_rises_to_its_peak_and_falls_to_nearly_nothing() -> None:
    """4 % at the start, (4 + 100) / 2 % half-way up, all at 30 %, half of it at 65 %, nothing at
    the end."""
    rates = [one_cycle(progress) for progress in (0, 0.15, 0.3, 0.65, 1)]
    np.testing.assert_allclose(rates, [0.04, 0.52, 1, 0.5, 0], atol=5e-7)
