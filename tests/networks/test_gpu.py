"""Tests of the networks on a GPU, if there is one: the same training gives the same network, and
the answers are those of a processor."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from pipeline.core.progress import Progress
from pipeline.methods.pfl.adversarial import SETTLING_BATCHES
from pipeline.methods.pfl.game import OBJECTIVES
from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from tests.interrupted import PowerCut
from tests.methods import test_adversarial as adversarial
from tests.methods import test_pfl as pfl
from tests.networks.test_classifier import GROUND_TRUTH, SETTINGS, rows

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here"),
]
LONGER: dict[str, Any] = SETTINGS | {"epochs": 16, "dropout": 0.2, "precision": "auto"}


@contextmanager
def processor() -> Iterator[None]:
    """Hides the GPU from the networks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.cuda, "is_available", lambda: False)
        yield


@pytest.mark.parametrize("method", [Sci(**LONGER), SciRing(**LONGER)], ids=["sci", "sci_ring"])
def test_a_gpu_trains_a_model_that_a_processor_answers_with(
    method: Classifier,
) -> None:
    torch.cuda.reset_peak_memory_stats()
    model = method.learn(rows(), GROUND_TRUTH, Progress())
    assert torch.cuda.max_memory_allocated() > 0  # it was used
    on_gpu = method.localizer(model)(rows(), 4)
    with processor():
        on_processor = method.localizer(model)(rows(), 4)
    assert (on_gpu.places[:, 0] == GROUND_TRUTH).mean() > 0.9
    np.testing.assert_array_equal(on_gpu.places[:, 0], on_processor.places[:, 0])
    # bfloat16 on the one, perhaps not on the other
    np.testing.assert_allclose(on_gpu.costs, on_processor.costs, atol=0.05)


@pytest.mark.parametrize("kind", [Sci, SciRing])
def test_a_few_steps_cost_on_a_gpu_what_they_cost_on_a_processor(kind: type[Classifier]) -> None:
    """Two trainings see the same views, turned and coloured the same way, in the same order."""
    method = kind(**SETTINGS | {"epochs": 2, "dropout": 0.0})
    on_gpu = method.learn(rows(), GROUND_TRUTH, Progress())
    with processor():
        on_processor = method.learn(rows(), GROUND_TRUTH, Progress())
    for name in ("curves/loss", "curves/validation_loss"):
        np.testing.assert_allclose(on_gpu[name], on_processor[name], rtol=0.05, atol=0.02)


@pytest.mark.parametrize("objective", ["least_squares", "paper"])
def test_a_few_turns_of_the_game_cost_on_a_gpu_what_they_cost_on_a_processor(
    objective: str,
) -> None:
    def curves(name: str) -> dict[str, np.ndarray]:
        game = adversarial.small(OBJECTIVES[objective])
        for layer in game.modules():
            if isinstance(layer, nn.Dropout):  # a GPU draws its own
                layer.p = 0.0
        game.to(torch.device(name))

        def judge(game: Any) -> dict[str, float]:
            images = adversarial.to_pixels(adversarial.DATA[:5], torch.device(name))
            with torch.inference_mode():
                return adversarial.measure_health(game.encoder, game.decoder, images)

        return adversarial.train(game, judge=judge, rounds=2)

    on_gpu = curves("cuda")
    with processor():
        on_processor = curves("cpu")
    assert on_gpu.keys() == on_processor.keys()
    for name, column in on_processor.items():
        np.testing.assert_allclose(on_gpu[name], column, rtol=0.05, atol=0.02, err_msg=name)


def test_a_gpu_learns_place_features_that_a_processor_answers_with() -> None:
    torch.cuda.reset_peak_memory_stats()
    method = replace(pfl.SMALL, precision="auto")
    model = method.learn(pfl.rows(), pfl.PLACES, pfl.PROGRESS)
    assert torch.cuda.max_memory_allocated() > pfl.rows().images.nbytes  # the views lie there
    images = pfl.rows(2).images[:, 0]
    codes = method.encoder(model)(images)
    assert method.localizer(model)(pfl.rows(2), 3).places.shape == (pfl.ROWS, 3)
    with processor():
        assert method.localizer(model)(pfl.rows(2), 3).places.shape == (pfl.ROWS, 3)
        precise = replace(method, precision="f32").encoder(model)(images)
    error = np.linalg.norm(codes - precise, axis=1)
    assert (error < 0.05 * np.linalg.norm(precise, axis=1)).all()


@pytest.mark.parametrize("name", ["sci", "sci_ring", "pfl"])
def test_a_gpus_interrupted_training_goes_on_from_its_checkpoint(tmp_path: Path, name: str) -> None:
    method, views, places = {
        "sci": (Sci(**SETTINGS), rows(), GROUND_TRUTH),
        "sci_ring": (SciRing(**SETTINGS), rows(), GROUND_TRUTH),
        "pfl": (pfl.SMALL, pfl.rows(), pfl.PLACES),
    }[name]
    whole = method.learn(views, places, Progress())
    with pytest.raises(KeyboardInterrupt):
        method.learn(views, places, PowerCut(checkpoint=tmp_path / "half"))
    assert (tmp_path / "half").is_file()
    resumed = method.learn(views, places, Progress(checkpoint=tmp_path / "half"))
    for curve in (part for part in whole if part.startswith("curves/") and "accuracy" not in part):
        # dropout's draws are the same, the order of sums is not
        np.testing.assert_allclose(resumed[curve], whole[curve], rtol=0.1, atol=0.05, err_msg=curve)


def waits(train: Callable[[], object]) -> int:
    """The number of times that a processor waits for the GPU, once everything is loaded."""
    train()
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            torch.cuda.set_sync_debug_mode("warn")
            train()
    finally:
        torch.cuda.set_sync_debug_mode("default")
    return sum("synchronizing CUDA operation" in str(warning.message) for warning in caught)


@pytest.mark.parametrize("kind", [Sci, SciRing])
def test_no_step_of_a_classifier_waits_for_the_gpu(kind: type[Classifier]) -> None:
    by_batch = []
    for batch in (16, 4):
        method = kind(**SETTINGS | {"batch": batch, "precision": "auto"})
        net = method.network(4, 8, 24).to("cuda")
        batches, steps = method.batches(
            method.heights(rows().images), rows(), torch.from_numpy(GROUND_TRUTH), torch.arange(48)
        )

        def train(
            net: nn.Module = net, batches: Any = batches, steps: int = steps, method: Any = method
        ) -> None:
            loop.fit(
                net,
                batches,
                None,
                epochs=1,
                steps=steps,
                learning_rate=0.001,
                schedule="constant",
                precision="auto",
                seed=0,
                progress=Progress(),
                step=method.step,
            )

        by_batch.append(waits(train))
    assert by_batch[0] == by_batch[1]


@pytest.mark.parametrize("objective", ["least_squares", "paper"])
def test_no_iteration_of_the_game_waits_for_the_gpu(objective: str) -> None:
    game = adversarial.small(OBJECTIVES[objective]).to("cuda")
    method = replace(adversarial.HOW, precision="auto")

    def waits_of(iterations: int) -> int:
        return waits(
            lambda: method.play(game, adversarial.DATA, lambda game: {}, 1, iterations, Progress())
        )

    assert waits_of(SETTLING_BATCHES) == waits_of(2 * SETTLING_BATCHES)
