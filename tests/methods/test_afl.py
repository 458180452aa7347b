"""Tests that AFL is PFL without the terms that stabilise it."""

from dataclasses import fields
from math import log

import numpy as np
import pytest
import torch

from pipeline.core.progress import Progress
from pipeline.methods.pfl.afl import Afl
from pipeline.methods.pfl.pfl import Pfl
from tests.matching.made import along


def test_it_learns_by_the_joint_game_alone() -> None:
    images = np.random.default_rng(0).integers(0, 256, (6, 16, 64, 64)).astype(np.uint8)
    small = Afl(
        width=1, epochs=1, batch=16, generator_steps=1, precision="f32", threads=1, length=2
    )
    model = small.learn(along(images), np.zeros(6, np.int64), Progress())
    terms = {name.removeprefix("curves/") for name in model if name.startswith("curves/")}
    health = {"held_out_accuracy", "held_out_error", "black_error", "code_variance"}
    health |= {"code_distance"}
    assert terms == {"joint_discriminator", "joint_generator"} | health
    assert model["codes"].shape == (6, 8, 512)


def test_its_costs_are_those_that_pfl_has_under_the_same_name() -> None:
    costs = {name: Afl(objective=name).terms() for name in ("least_squares", "bce", "paper")}  # type: ignore[arg-type]
    scores = torch.tensor([[0.0], [log(3)]])
    # D = ½ and ¾. BiGAN: −log D of what should be 1, −log(1 − D) of what should be 0.
    ones = (log(2) + log(4 / 3)) / 2
    zeros = (log(2) + log(4)) / 2
    assert costs["bce"].cost(scores, 1.0).item() == pytest.approx(ones)
    assert costs["bce"].discriminator_cost(scores, scores).item() == pytest.approx(
        (ones + zeros) / 2
    )
    assert costs["least_squares"].cost(scores, 1.0).item() == pytest.approx(
        (1 + (log(3) - 1) ** 2) / 2
    )
    assert costs["bce"].generator_cost(scores, 0.0).item() == pytest.approx(ones)
    assert costs["paper"].generator_cost(scores, 0.0).item() == pytest.approx(-zeros)
    assert all(
        Pfl(objective=name).terms().loss == terms.loss  # type: ignore[arg-type]
        for name, terms in costs.items()
    )


def test_it_has_pfls_settings_and_default_objective() -> None:
    ours, theirs = (
        {field.name: field.default for field in fields(method)} for method in (Afl, Pfl)
    )
    assert ours["objective"] == "least_squares"
    assert ours == theirs
