"""AFL: place features learned by the joint adversarial game alone (Yin et al., IROS 2018; METHODS
5.1).

Networks, training and matching are those of `FeatureMethod`, as for PFL; the loss has fewer terms.
"""

from dataclasses import dataclass
from typing import Literal

from pipeline.methods.pfl.features import FeatureMethod
from pipeline.methods.pfl.game import OBJECTIVES, Objective


@dataclass(frozen=True)
class Afl(FeatureMethod):
    """Adversarial feature learning: the joint game of PFL, without PFL's further terms."""

    objective: Literal["least_squares", "bce", "paper"] = "least_squares"
    """The cost of scores, the same as PFL's with this name: squares as in the authors' code, the
    logistic cost of BiGAN, or the minimax of the paper's text, with one step per iteration. So a
    comparison of PFL with AFL compares their terms, not their costs."""

    def terms(self) -> Objective:
        """The losses of the joint discriminator and of the generators that try to fool it."""
        return OBJECTIVES[self.objective].joint_alone()
