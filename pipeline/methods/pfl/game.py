"""The game that place features are learned by: who plays, and for which terms (METHODS 5.1).

Yin et al., IROS 2018, eq. 7–11, and their code where it says otherwise. A joint discriminator tells
pairs of an image and its code from pairs of an image made of a code and that code; encoder and
decoder learn to be mistaken for each other. PFL stabilises this by a discriminator of images alone
and by reconstructing images and codes.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, mse_loss

from pipeline.methods.pfl.bigan import Head


@dataclass(frozen=True)
class Objective:
    """Loss terms, and the weight of each besides the joint discriminator's.

    A term of weight 0 is not computed.
    """

    loss: Literal["least_squares", "bce"] = "least_squares"
    image: float = 0.1  # of the game on images alone
    fakes: Literal["prior", "reconstruction", "both"] = "prior"
    """What the image discriminator takes for fakes: images of random codes, of images' own codes,
    or half and half."""
    image_cycle: float = 0.1
    code_cycle: float = 0.1
    head: Head = "scalar"

    def cost(self, scores: Tensor, right_score: float) -> Tensor:
        """Mean cost of scores that should all be 0 or all be 1."""
        target = torch.full_like(scores, right_score, dtype=torch.float32)
        if self.loss == "bce":
            return binary_cross_entropy_with_logits(scores.float(), target)
        return mse_loss(scores.float(), target)

    def halves(self, should_be_one: Tensor, should_be_zero: Tensor) -> Tensor:
        """Mean of the costs of scores that should be 1 and scores that should be 0."""
        return (self.cost(should_be_one, 1.0) + self.cost(should_be_zero, 0.0)) / 2


OBJECTIVES: Mapping[str, Objective] = {
    "least_squares": Objective(),
    "bce": Objective("bce"),
    "paper": Objective("bce", 1.0, "reconstruction", 1.0, 1.0),
    "author_code": Objective(code_cycle=0.0, head="vector"),
    "both_fakes": Objective(fakes="both"),
    "afl": Objective(image=0.0, image_cycle=0.0, code_cycle=0.0),
}
"""`paper` is the text; `author_code` dropped the cycle of codes and judges feature vectors; `afl`
is the joint game alone."""


class Game(nn.Module):
    """The players, and each one's loss on images (batch, 1, 64, 64) and random codes.

    Codes are (batch, code). A loss is given term by term.
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
        """The turns in their order; those of the generators are repeated."""
        makers = (self.encoder, self.decoder)
        turns = [Turn("joint_discriminator", (self.joint,), self.judge_pairs)]
        if self.image is not None:
            turns.append(Turn("image_discriminator", (self.image,), self.judge_images))
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
            "joint_discriminator": self.objective.halves(
                self.joint(images, image_codes), self.joint(fakes, codes)
            )
        }

    def fool_pairs(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The encoder's and decoder's loss: the joint discriminator's with 0 and 1 exchanged."""
        image_codes = self.encoder(images)
        fakes = self.decoder(codes)
        return {
            "joint_generator": self.objective.halves(
                self.joint(fakes, codes), self.joint(images, image_codes)
            )
        }

    def judge_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The image discriminator's loss: 1 for a real image, 0 for a generated one."""
        assert self.image is not None
        with torch.no_grad():
            fakes = self._fakes(images, codes)
        real = self.image(images)
        halves = [self.objective.halves(real, self.image(fake)) for fake in fakes]
        return {"image_discriminator": self.objective.image * torch.stack(halves).mean()}

    def fool_images(self, images: Tensor, codes: Tensor) -> dict[str, Tensor]:
        """The decoder's loss: 1 for a generated image."""
        assert self.image is not None
        costs = [self.objective.cost(self.image(fake), 1.0) for fake in self._fakes(images, codes)]
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
        fakes_of = {
            "prior": lambda: self.decoder(codes),
            "reconstruction": lambda: self.decoder(self.encoder(images)),
        }
        return [fakes_of[kind]() for kind in fakes_of if self.objective.fakes in (kind, "both")]


@dataclass(frozen=True)
class Turn:
    """The players of one turn, and their loss terms."""

    name: str
    players: tuple[nn.Module, ...]
    terms: Callable[[Tensor, Tensor], dict[str, Tensor]]
    repeated: bool = False
