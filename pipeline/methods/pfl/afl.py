"""AFL: place features learned by the joint adversarial game alone, which PFL stabilises (Yin et
al., IROS 2018; METHODS 5.1)."""

from dataclasses import dataclass
from typing import Literal

from pipeline.methods.pfl.features import FeatureMethod
from pipeline.methods.pfl.game import OBJECTIVES, Objective


@dataclass(frozen=True)
class Afl(FeatureMethod):
    """Adversarial feature learning, with the cost of one of PFL's objectives."""

    objective: Literal["least_squares", "bce", "paper"] = "least_squares"
    """The cost that PFL has under this name: the authors' squares, BiGAN's logistic cost, or the
    text's minimax, one step an iteration. So PFL against AFL compares terms, not costs."""

    def terms(self) -> Objective:
        """The joint discriminator's line and the generators'."""
        return OBJECTIVES[self.objective].joint_alone()
