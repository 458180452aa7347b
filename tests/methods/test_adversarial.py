"""Tests of the adversarial game and its training: each loss term by hand, which networks a turn
changes, and which round is kept."""

from collections.abc import Callable
from dataclasses import replace
from math import exp, log, log1p
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.progress import Progress
from pipeline.methods.pfl.adversarial import (
    ACCURACY,
    AdversarialMethod,
    _take_step,
    measure_health,
    settle,
    to_pixels,
)
from pipeline.methods.pfl.bigan import Decoder, Encoder, ImageDiscriminator, JointDiscriminator
from pipeline.methods.pfl.game import OBJECTIVES, Game, Objective
from pipeline.networks.loop import reproducible


class Fixed(nn.Module):
    """A function in a network's place."""

    def __init__(self, function: Callable[..., Tensor]) -> None:
        super().__init__()
        self.function = function

    def forward(self, *inputs: Tensor) -> Tensor:
        return self.function(*inputs)


IMAGES = torch.tensor([[1.0], [3.0]])
CODES = torch.tensor([[2.0], [-2.0]])


def toy(objective: Objective) -> dict[str, float]:
    """All terms where En(x) = x/2, De(z) = z + 1, D_J(x, z) = x + z and D_X(x) = x."""
    game = Game(
        Fixed(lambda x: x / 2),
        Fixed(lambda z: z + 1),
        Fixed(lambda x, z: x + z),
        Fixed(lambda x: x) if objective.image else None,
        objective,
    )
    return {
        name: float(term)
        for turn in game.turns()
        for name, term in turn.terms(IMAGES, CODES).items()
    }


# En(x) = ½, 3/2; De(z) = 3, −1; De(En(x)) = 3/2, 5/2; En(De(z)) = 3/2, −½.
# D_J: own pairs 3/2, 9/2; made ones 5, −3. Squares from 1: (¼ + 49/4)/2 = 25/4 and (16 + 16)/2 =
# 16; from 0: 45/4 and 17.
JOINT = {"joint_discriminator": (25 / 4 + 17) / 2, "joint_generator": (45 / 4 + 16) / 2}
# x − De(En(x)) = −½, ½: ¼. z − En(De(z)) = ½, −3/2: 5/4.
CYCLES = {"image_cycle": 0.1 / 4, "code_cycle": 0.1 * 5 / 4}
# D_X: seen 1, 3: from 1, 2. Made of random codes 3, −1: from 0, 5; from 1, 4. Of own codes 3/2,
# 5/2: from 0, 17/4; from 1, 5/4.
PRIOR = {"image_discriminator": 0.1 * (2 + 5) / 2, "image_generator": 0.1 * 4}
BOTH = {
    "image_discriminator": 0.1 * ((2 + 5) / 2 + (2 + 17 / 4) / 2) / 2,
    "image_generator": 0.1 * (4 + 5 / 4) / 2,
}


def bce(ones: tuple[float, float] | None, zeros: tuple[float, float] | None) -> float:
    """Mean logistic cost: log(1 + e^−s) of what should be 1, log(1 + e^s) of what should be 0."""
    costs = [sum(log1p(exp(-score)) for score in ones) / 2] if ones else []
    costs += [sum(log1p(exp(score)) for score in zeros) / 2] if zeros else []
    return sum(costs) / len(costs)


LOGISTIC = {
    "joint_discriminator": bce((1.5, 4.5), (5, -3)),
    "joint_generator": bce((5, -3), (1.5, 4.5)),
}
# E log D(x, En(x)) + E log(1 − D(De(z), z)): D rises by it, En and De fall by it.
VALUE = sum(log(1 / (1 + exp(-s))) for s in (1.5, 4.5)) / 2
VALUE += sum(log(1 - 1 / (1 + exp(-s))) for s in (5, -3)) / 2
MINIMAX = {"joint_discriminator": -VALUE, "joint_generator": VALUE}
EXPECTED = {
    "least_squares": JOINT | PRIOR | CYCLES,
    "bce": LOGISTIC
    | {
        "image_discriminator": 0.1 * bce((1, 3), (3, -1)),
        "image_generator": 0.1 * bce((3, -1), None),
    }
    | CYCLES,
    "paper": MINIMAX
    | {
        "image_discriminator": bce((1, 3), None) + bce(None, (1.5, 2.5)),
        "image_generator": -bce(None, (1.5, 2.5)),
    }
    | {"image_cycle": 1 / 4, "code_cycle": 5 / 4},
    "author_code": JOINT | PRIOR | {"image_cycle": CYCLES["image_cycle"]},
    "both_fakes": JOINT | BOTH | CYCLES,
}
JOINTS = {"least_squares": JOINT, "bce": LOGISTIC, "paper": MINIMAX}
AFL = OBJECTIVES["least_squares"].joint_alone()


@pytest.mark.parametrize(
    ("objective", "expected"),
    [
        *((OBJECTIVES[name], terms) for name, terms in EXPECTED.items()),
        *((OBJECTIVES[name].joint_alone(), terms) for name, terms in JOINTS.items()),
    ],
    ids=[*EXPECTED, *(f"{name}, joint alone" for name in JOINTS)],
)
def test_each_objective_has_its_terms_and_afl_is_the_joint_game_alone(
    objective: Objective, expected: dict[str, float]
) -> None:
    assert toy(objective) == pytest.approx(expected, rel=1e-6)
    assert EXPECTED.keys() == OBJECTIVES.keys()


def small(objective: Objective, seed: int = 0) -> Game:
    torch.manual_seed(seed)
    return Game(
        Encoder(1, code=6),
        Decoder(1, code=6),
        JointDiscriminator(1, code=6),
        ImageDiscriminator(1, head=objective.head) if objective.image else None,
        objective,
    )


def test_a_turn_gives_gradients_to_its_players_and_afl_has_two_turns() -> None:
    game = small(OBJECTIVES["least_squares"])
    makers = {game.encoder, game.decoder}
    assert [(turn.name, set(turn.players), turn.repeated) for turn in game.turns()] == [
        *(
            ("joint_discriminator", {game.joint}, False),
            ("image_discriminator", {game.image}, False),
            ("cycle", makers, False),
        ),
        *(("image_generator", {game.decoder}, True), ("joint_generator", makers, True)),
    ]
    assert [turn.name for turn in small(AFL).turns()] == ["joint_discriminator", "joint_generator"]


def test_the_papers_encoder_and_decoder_take_one_step_down_the_sum_of_all_terms() -> None:
    game = small(OBJECTIVES["paper"])
    game.joint.eval()  # without dropout
    *first_turns, turn = game.turns()
    assert [(one.name, one.repeated) for one in first_turns] == [
        ("joint_discriminator", False),
        ("image_discriminator", False),
    ]
    assert set(turn.players) == {game.encoder, game.decoder}
    assert not turn.repeated
    weights = [game.encoder.dense.weight, game.decoder.dense.weight]
    terms = turn.terms(to_pixels(DATA[:4], torch.device("cpu")), torch.randn(4, 6))
    assert terms.keys() == {"image_cycle", "code_cycle", "image_generator", "joint_generator"}
    slopes = [
        torch.stack(torch.autograd.grad(term, weights, retain_graph=True)[:1])
        for term in terms.values()
    ]
    assert all(slope.abs().max() > 0 for slope in slopes)  # eq. 7's and 9's move the encoder too
    before = game.encoder.dense.weight.detach().clone()
    optimizer = torch.optim.SGD(weights)
    _take_step(optimizer, 0.1, sum(terms.values(), torch.zeros(())))  # type: ignore[arg-type]
    torch.testing.assert_close(
        game.encoder.dense.weight.detach(), before - 0.1 * sum(slopes)[0], rtol=1e-4, atol=1e-7
    )


def test_the_paper_has_one_generator_step_whatever_is_set() -> None:
    game, other = small(OBJECTIVES["paper"]), small(OBJECTIVES["paper"])
    train(game)
    train(other, how=replace(HOW, generator_steps=1))
    assert same(game, other)


DATA = np.random.default_rng(0).integers(0, 256, (20, 64, 64)).astype(np.uint8)


def looked_at(game: Game) -> dict[str, float]:
    with torch.inference_mode():
        return measure_health(game.encoder, game.decoder, to_pixels(DATA[:5], torch.device("cpu")))


HOW = AdversarialMethod(
    code=6,
    batch=4,
    learning_rate=0.001,
    schedule="one_cycle",
    generator_steps=2,
    precision="f32",
    seed=3,
)


def train(
    game: Game,
    progress: Progress | None = None,
    judge: Callable[[Game], dict[str, float]] = looked_at,
    rounds: int = 3,
    how: AdversarialMethod = HOW,
) -> dict[str, np.ndarray]:
    with reproducible(1):
        return how.play(game, DATA, judge, rounds, 2, progress or Progress())


def same(one: nn.Module, other: nn.Module) -> bool:
    return all(
        torch.equal(value, other.state_dict()[name]) for name, value in one.state_dict().items()
    )


def test_all_players_learn_and_the_last_weights_stay() -> None:
    game = small(OBJECTIVES["least_squares"])
    before = small(OBJECTIVES["least_squares"])
    curves = train(game)
    assert not any(
        same(part, other) for part, other in zip(game.children(), before.children(), strict=True)
    )
    assert looked_at(game.eval())["validation_error"] == curves["validation_error"][-1]


def test_the_last_round_is_kept_where_places_are_not_to_choose() -> None:
    right = iter((0.75, 0.5))
    last = replace(HOW, kept="last")
    game = small(OBJECTIVES["least_squares"])
    before = small(OBJECTIVES["least_squares"])
    curves = train(game, judge=lambda game: {ACCURACY: next(right)}, rounds=2, how=last)
    train(before, judge=lambda game: {"validation_error": 1.0}, rounds=2)  # the last of equals
    assert (last.kept_round(curves), HOW.kept_round(curves)) == (1, 0)
    assert same(game.encoder, before.encoder)


@pytest.mark.parametrize("kept", ["best", "last"])
def test_without_epochs_only_the_batch_norms_are_settled(kept: Any) -> None:
    game = small(OBJECTIVES["least_squares"])
    drawn = small(OBJECTIVES["least_squares"])
    curves = train(game, rounds=1, how=replace(HOW, epochs=0, kept=kept))
    assert {len(column) for column in curves.values()} == {1}
    assert "image_cycle" not in curves
    assert all(map(torch.equal, game.parameters(), drawn.parameters()))
    assert looked_at(game.eval()) == {name: column[0] for name, column in curves.items()}
    assert game.encoder.halvings[0][1].running_mean.abs().max() > 0  # type: ignore[index, operator, union-attr]


def test_another_trainings_checkpoint_is_refused(tmp_path: Path) -> None:
    train(small(AFL), Progress(checkpoint=tmp_path / "c"), rounds=1)
    with pytest.raises(ArtifactError, match="not a whole checkpoint"):
        train(small(OBJECTIVES["least_squares"]), Progress(checkpoint=tmp_path / "c"))


def test_a_term_that_is_no_number_stops_the_training() -> None:
    game = small(OBJECTIVES["least_squares"])
    game.encoder.dense.bias.data[:] = float("nan")  # type: ignore[union-attr, index, operator]
    with pytest.raises(ConfigError, match="in round 1 is nan"):
        train(game)


def test_a_collapse_is_seen() -> None:
    images = torch.tensor([[[[0.0]]], [[[1.0]]]])
    # Codes (0, 0) and (3, 4): 5 apart, variances 9/2 and 16/2. The decoder answers 1: squares of 1
    # and 0. Black is −1: squares of 1 and 2.
    seen = measure_health(
        Fixed(lambda x: x.flatten(1) * torch.tensor([3.0, 4.0])),
        Fixed(lambda z: torch.ones(2, 1, 1, 1)),
        images,
    )
    assert seen == pytest.approx(
        {"validation_error": 0.5, "black_error": 2.5, "code_variance": 6.25, "code_distance": 5.0}
    )
    collapsed = measure_health(
        Fixed(lambda x: torch.ones(2, 2)), Fixed(lambda z: torch.ones(2, 1, 1, 1)), images
    )
    assert collapsed["code_variance"] == collapsed["code_distance"] == 0


def test_running_statistics_are_those_of_what_was_seen() -> None:
    game = small(AFL)
    game.encoder(100 * torch.ones(4, 1, 64, 64))
    images = to_pixels(DATA, torch.device("cpu"))
    settle(game.encoder, game.decoder, images.split(10))
    convolution, norm = game.encoder.halvings[0]  # type: ignore[index, operator, union-attr]
    torch.testing.assert_close(
        norm.running_mean, convolution(images).mean((0, 2, 3)), atol=1e-5, rtol=1e-4
    )


def test_pixels_run_from_minus_one_to_one() -> None:
    assert to_pixels(np.array([[[0, 255]]], np.uint8), torch.device("cpu")).flatten().tolist() == [
        -1.0,
        1.0,
    ]
