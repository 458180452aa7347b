"""The adversarial game by which place features are learned: networks in, their losses out.

It follows Yin et al., IROS 2018, eq. 7–11, or their code where it differs (METHODS 5.1). An encoder
maps an image to a code, a decoder maps a code to an image. A joint discriminator learns to
distinguish pairs of a real image and its code from pairs of a random code and its decoded image;
encoder and decoder learn to make pairs that it cannot distinguish. This is AFL. PFL stabilises the
game with a second discriminator, of images alone, and with the error of a pass through both
networks: image to code to image, and code to image to code (the cycles).
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
    """The loss of the game: the cost of scores, and the weight of each term beside the joint game.

    A term with weight 0 is not computed.
    """

    loss: Literal["least_squares", "bce", "minimax"] = "least_squares"
    """The cost of wrong scores: squares, or logistic costs. With the paper's `minimax` the
    generators maximise the logistic costs that the discriminators minimise, and costs are summed
    instead of averaged."""
    image: float = 0.1
    """Weight of the game on images alone."""
    fakes: Literal["prior", "reconstruction", "both"] = "prior"
    """The generated images that the image discriminator learns to distinguish from real images:
    images decoded from random codes, from the codes of real images, or half of each."""
    image_cycle: float = 0.1
    """Weight of the error of an image that is encoded and decoded."""
    code_cycle: float = 0.1
    """Weight of the error of a code that is decoded and encoded."""
    head: Head = "scalar"
    """Whether the image discriminator scores the image as a whole, or each of its features."""
    summed: bool = False
    """Whether encoder and decoder take one step per iteration, down the sum of all their terms (eq.
    11), instead of one step for each term. Then the term of eq. 7 trains the encoder too."""

    def joint_alone(self) -> "Objective":
        """The same cost of scores, but only the joint game: AFL."""
        return replace(self, image=0.0, image_cycle=0.0, code_cycle=0.0, head="scalar")

    def cost(self, scores: Tensor, right_score: float) -> Tensor:
        """Mean cost of scores that should all be `right_score`, 0 or 1."""
        target = torch.full_like(scores, right_score, dtype=torch.float32)
        if self.loss == "least_squares":
            return mse_loss(scores.float(), target)
        return binary_cross_entropy_with_logits(scores.float(), target)

    def discriminator_cost(self, real_scores: Tensor, fake_scores: Tensor) -> Tensor:
        """A discriminator's cost of scores that should be 1 and of scores that should be 0."""
        both = self.cost(real_scores, 1.0) + self.cost(fake_scores, 0.0)
        return both if self.loss == "minimax" else both / 2

    def generator_cost(self, scores: Tensor, right_score: float) -> Tensor:
        """The generators' cost of scores that are all `right_score` for a good discriminator.

        It is the cost of the opposite score. In `minimax` it is minus the discriminator's cost,
        log(1 − D) or log D, whose gradient vanishes where the discriminator is certain.
        """
        if self.loss == "minimax":
            return -self.cost(scores, right_score)
        return self.cost(scores, 1.0 - right_score)


OBJECTIVES: Mapping[str, Objective] = {
    "least_squares": Objective(),
    "bce": Objective(loss="bce"),
    "paper": Objective(
        loss="minimax",
        image=1.0,
        fakes="reconstruction",
        image_cycle=1.0,
        code_cycle=1.0,
        summed=True,
    ),
    "author_code": Objective(code_cycle=0.0, head="vector"),
    "both_fakes": Objective(fakes="both"),
}
"""Objectives by the names that PFL's and AFL's settings use. `paper` is the paper's text, eq. 7 to
11 as written; `author_code` has no cycle of codes, and scores each feature of an image."""


class Game(nn.Module):
    """The networks, and the loss of each network.

    All losses take images (batch, 1, 64, 64) and random codes (batch, code), and return terms by
    name, which the caller sums.
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
        """The turns of an iteration in their order.

        The generators' turns may be taken several times, unless their terms are summed.
        """
        coders = (self.encoder, self.decoder)  # together, the generators of the joint game
        turns = [Turn("joint_discriminator", (self.joint,), self.judge_pairs)]
        if self.image is not None:
            turns.append(Turn("image_discriminator", (self.image,), self.judge_images))
        if self.objective.summed:
            return [*turns, Turn("generators", coders, self.minimise)]
        if self.objective.image_cycle or self.objective.code_cycle:
            turns.append(Turn("cycle", coders, self.reconstruct))
        if self.image is not None:
            turns.append(Turn("image_generator", (self.decoder,), self.fool_images, repeated=True))
        return [*turns, Turn("joint_generator", coders, self.fool_pairs, repeated=True)]

    def judge_pairs(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The joint discriminator's loss.

        It should score an image with its code 1, and a random code with its image 0.
        """
        with torch.no_grad():
            image_codes = self.encoder(images)
            fakes = self.decoder(codes)
        return {
            "joint_discriminator": self.objective.discriminator_cost(
                self.joint(images, image_codes), self.joint(fakes, codes)
            )
        }

    def minimise(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """All losses of the encoder and decoder, which the caller sums (eq. 11)."""
        terms = self.reconstruct(images, codes)
        if self.image is not None:
            terms |= self.fool_images(images, codes)
        return terms | self.fool_pairs(images, codes)

    def fool_pairs(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The loss of the encoder and decoder in the joint game: pairs should get the opposite
        scores."""
        image_codes = self.encoder(images)
        fakes = self.decoder(codes)
        fake_cost = self.objective.generator_cost(self.joint(fakes, codes), 0.0)
        real_cost = self.objective.generator_cost(self.joint(images, image_codes), 1.0)
        both = fake_cost + real_cost
        return {"joint_generator": both if self.objective.loss == "minimax" else both / 2}

    def judge_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The image discriminator's loss: it should score real images 1, generated images 0."""
        assert self.image is not None
        with torch.no_grad():
            fakes = self._fakes(images, codes)
        real = self.image(images)
        costs = [self.objective.discriminator_cost(real, self.image(fake)) for fake in fakes]
        return {"image_discriminator": self.objective.image * torch.stack(costs).mean()}

    def fool_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The decoder's loss, with summed terms also the encoder's: fakes should score 1."""
        assert self.image is not None
        costs = [
            self.objective.generator_cost(self.image(fake), 0.0)
            for fake in self._fakes(images, codes)
        ]
        return {"image_generator": self.objective.image * torch.stack(costs).mean()}

    def reconstruct(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The loss of the encoder and decoder in the cycles: mean squared error of a pass through
        both."""
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
        """The generated images that `Objective.fakes` names: one batch, or two for `both`."""
        fakes = []
        if self.objective.fakes in ("prior", "both"):
            fakes.append(self.decoder(codes))
        if self.objective.fakes in ("reconstruction", "both"):
            fakes.append(self.decoder(self.encoder(images)))
        return fakes


@dataclass(frozen=True)
class Turn:
    """One step of an optimiser in an iteration: the networks that it trains, and their loss."""

    name: str
    players: tuple[nn.Module, ...]
    terms: Callable[[Tensor, Tensor], dict[str, Tensor]]
    """Computes the loss terms from images and codes; their sum is the loss."""
    repeated: bool = False
    """Whether the turn is taken `generator_steps` times in an iteration."""
