"""AFL is PFL without what stabilises it."""

from dataclasses import fields

import numpy as np

from pipeline.matching.ranking import Rows
from pipeline.methods.pfl.afl import Afl
from pipeline.methods.pfl.pfl import Pfl
from pipeline.running.progress import Progress

HEALTH = ("held_out_accuracy", "held_out_error", "code_variance", "code_distance")


def test_it_learns_by_the_joint_game_alone() -> None:
    images = np.random.default_rng(0).integers(0, 256, (6, 16, 64, 64)).astype(np.uint8)
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6)
    small = Afl(width=1, epochs=1, batch=16, generator_steps=1, precision="f32", threads=1, length=2)
    model = small.learn(Rows(images, np.arange(6), poses), np.zeros(6, np.int64), Progress())
    terms = {name.removeprefix("curves/") for name in model if name.startswith("curves/")}
    assert terms == {"joint_discriminator", "joint_generator", *HEALTH}
    assert model["codes"].shape == (6, 8, 512)


def test_it_has_pfls_settings_but_the_objective() -> None:
    ours, theirs = ({field.name: field.default for field in fields(method)} for method in (Afl, Pfl))
    assert theirs.pop("objective") == "least_squares"
    assert ours == theirs
