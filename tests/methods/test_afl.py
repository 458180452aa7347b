"""Tests that AFL is PFL without the terms that stabilise it."""

import numpy as np

from pipeline.core.progress import Progress
from pipeline.methods.pfl.afl import Afl
from tests.matching.made import along


def test_it_learns_by_the_joint_game_alone() -> None:
    images = np.random.default_rng(0).integers(0, 256, (6, 16, 64, 64)).astype(np.uint8)
    small = Afl(
        width=1, epochs=1, batch=16, generator_steps=1, precision="f32", threads=1, length=2
    )
    model = small.learn(along(images), np.zeros(6, np.int64), Progress())
    terms = {name.removeprefix("curves/") for name in model if name.startswith("curves/")}
    health = {"validation_accuracy", "validation_error", "black_error", "code_variance"}
    health |= {"code_distance"}
    assert terms == {"joint_discriminator", "joint_generator"} | health
    assert model["codes"].shape == (6, 8, 512)
