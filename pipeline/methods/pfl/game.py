"""The adversarial game by which place features are learned: networks in; loss terms out.

Yin et al., IROS 2018, eq. 7–11, and their code where it says otherwise (METHODS 5.1). An encoder
makes a code of an image, a decoder an image of a code. A joint discriminator tells pairs of a real
image and its code from pairs of a code and the image made of it; encoder and decoder learn to make
pairs that it mistakes for each other. That is AFL. PFL stabilises it by a discriminator that sees
images alone, and by the loss of a pass through both networks (the cycles).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, mse_loss

from pipeline.methods.pfl.bigan import Head


@dataclass(frozen=True)
class Objective:
    """The loss of the game: how scores cost, and the weight of each term besides the joint game.

    A term of weight 0 is not computed.
    """

    loss: Literal["least_squares", "bce", "minimax"] = "least_squares"
    """What wrong scores cost: their squares, or logistic costs. In `minimax`, the paper's own, the
    generators maximise what the discriminators minimise, and costs are summed, not averaged."""
    image: float = 0.1
    """Weight of the game on images alone."""
    fakes: Literal["prior", "reconstruction", "both"] = "prior"
    """What the image discriminator takes for fakes: images of random codes, of images' own codes,
    or half and half."""
    image_cycle: float = 0.1
    """Weight of the change of an image by encoder and decoder."""
    code_cycle: float = 0.1
    """Weight of the change of a code by decoder and encoder."""
    head: Head = "scalar"
    """What a discriminator scores: the pair as a whole, or each of its features."""
    summed: bool = False
    """Encoder and decoder take one step an iteration, down the sum of all their terms (eq. 11),
    instead of a turn for each; eq. 7's moves the encoder too."""

    def joint_alone(self) -> "Objective":
        """The same cost of scores in the joint game alone, which is AFL."""
        return replace(self, image=0.0, image_cycle=0.0, code_cycle=0.0, head="scalar")

    def cost(self, scores: Tensor, right_score: float) -> Tensor:
        """Mean cost of scores that should all be 0 or all be 1."""
        target = torch.full_like(scores, right_score, dtype=torch.float32)
        if self.loss == "least_squares":
            return mse_loss(scores.float(), target)
        return binary_cross_entropy_with_logits(scores.float(), target)

    def discriminator_cost(self, real_scores: Tensor, fake_scores: Tensor) -> Tensor:
        """A discriminator's cost of scores that should be 1 and of scores that should be 0."""
        both = self.cost(real_scores, 1.0) + self.cost(fake_scores, 0.0)
        return both if self.loss == "minimax" else both / 2

    def generator_cost(self, scores: Tensor, right_score: float) -> Tensor:
        """The generators' cost of scores that a discriminator wants to be all 0 or all 1.

        The cost of the other score; in `minimax` what the discriminator gains, log(1 − D) or log D,
        which saturates where the discriminator is sure.
        """
        if self.loss == "minimax":
            return -self.cost(scores, right_score)
        return self.cost(scores, 1.0 - right_score)


OBJECTIVES: Mapping[str, Objective] = {
    "least_squares": Objective(),
    "bce": Objective("bce"),
    "paper": Objective("minimax", 1.0, "reconstruction", 1.0, 1.0, summed=True),
    "author_code": Objective(code_cycle=0.0, head="vector"),
    "both_fakes": Objective(fakes="both"),
}
"""`paper` is the text, eq. 7 to 11 as written; `author_code` dropped the cycle of codes and judges
feature vectors."""


class Game(nn.Module):
    """The networks that play, and each one's loss.

    Losses are of images (batch, 1, 64, 64) and random codes (batch, code), given term by term.
    """

    def __init__(
        self,
        encoder: nn.Module,
        decoder: nn.Module,
        joint: nn.Module,
        image: nn.Module | None,
        objective: Objective,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self.joint = joint
        self.image = image
        self.objective = objective

    def turns(self) -> list["Turn"]:
        """The turns in their order; those of the generators are repeated, unless summed."""
        makers = (self.encoder, self.decoder)
        turns = [Turn("joint_discriminator", (self.joint,), self.judge_pairs)]
        if self.image is not None:
            turns.append(Turn("image_discriminator", (self.image,), self.judge_images))
        if self.objective.summed:
            return [*turns, Turn("generators", makers, self.minimise)]
        if self.objective.image_cycle or self.objective.code_cycle:
            turns.append(Turn("cycle", makers, self.reconstruct))
        if self.image is not None:
            turns.append(Turn("image_generator", (self.decoder,), self.fool_images, repeated=True))
        return [*turns, Turn("joint_generator", makers, self.fool_pairs, repeated=True)]

    def judge_pairs(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The joint discriminator's loss: 1 for an image with its code, 0 for a code's image."""
        with torch.no_grad():
            image_codes = self.encoder(images)
            fakes = self.decoder(codes)
        return {
            "joint_discriminator": self.objective.discriminator_cost(
                self.joint(images, image_codes), self.joint(fakes, codes)
            )
        }

    def minimise(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """All of the encoder's and decoder's losses, to be summed (eq. 11)."""
        terms = self.reconstruct(images, codes)
        if self.image is not None:
            terms |= self.fool_images(images, codes)
        return terms | self.fool_pairs(images, codes)

    def fool_pairs(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The encoder's and decoder's loss: 1 for a code's image, 0 for an image with its code."""
        image_codes = self.encoder(images)
        fakes = self.decoder(codes)
        fake_cost = self.objective.generator_cost(self.joint(fakes, codes), 0.0)
        real_cost = self.objective.generator_cost(self.joint(images, image_codes), 1.0)
        both = fake_cost + real_cost
        return {"joint_generator": both if self.objective.loss == "minimax" else both / 2}

    def judge_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The image discriminator's loss: 1 for a real image, 0 for a generated one."""
        assert self.image is not None
        with torch.no_grad():
            fakes = self._fakes(images, codes)
        real = self.image(images)
        costs = [self.objective.discriminator_cost(real, self.image(fake)) for fake in fakes]
        return {"image_discriminator": self.objective.image * torch.stack(costs).mean()}

    def fool_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The decoder's loss, and if summed the encoder's: 1 for a generated image."""
        assert self.image is not None
        costs = [
            self.objective.generator_cost(self.image(fake), 0.0)
            for fake in self._fakes(images, codes)
        ]
        return {"image_generator": self.objective.image * torch.stack(costs).mean()}

    def reconstruct(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The encoder's and decoder's loss: mean squared change by a pass through both."""
        terms = {}
        if self.objective.image_cycle:
            terms["image_cycle"] = self.objective.image_cycle * mse_loss(
                self.decoder(self.encoder(images)).float(), images
            )
        if self.objective.code_cycle:
            terms["code_cycle"] = self.objective.code_cycle * mse_loss(
                self.encoder(self.decoder(codes)).float(), codes
            )
        return terms

    def _fakes(self, images: Tensor, codes: Tensor) -> list[Tensor]:
        """The images that count as fakes, by `Objective.fakes`: one batch, or two of `both`."""
        fakes_of = {
            "prior": lambda: self.decoder(codes),
            "reconstruction": lambda: self.decoder(self.encoder(images)),
        }
        return [fakes_of[kind]() for kind in fakes_of if self.objective.fakes in (kind, "both")]


@dataclass(frozen=True)
class Turn:
    """One optimiser's step in an iteration: the networks that it changes, and their loss."""

    name: str
    players: tuple[nn.Module, ...]
    terms: Callable[[Tensor, Tensor], dict[str, Tensor]]
    """Loss terms of images and codes, to be summed."""
    repeated: bool = False
    """Whether it may be taken several times an iteration."""
