"""PFL: place features learned by two discriminators and two cycles, which stabilise the training
(Yin et al., IROS 2018).

The paper is "Stabilize an Unsupervised Feature Learning for LiDAR-based Place Recognition" (METHODS
5). Networks, training and matching are those of `FeatureMethod`; this module chooses the loss.
"""

from dataclasses import dataclass
from typing import Literal

from pipeline.methods.pfl.features import FeatureMethod
from pipeline.methods.pfl.game import OBJECTIVES, Objective


@dataclass(frozen=True)
class Pfl(FeatureMethod):
    """Place feature learning, with the loss of the paper, of its authors' code, or a mixture."""

    objective: Literal["least_squares", "bce", "paper", "author_code", "both_fakes"] = (
        "least_squares"
    )
    """A key of pipeline.methods.pfl.game.OBJECTIVES. `least_squares` and `bce` have the paper's
    terms with the weights of the authors' code. Only `paper` is the paper as written: it takes one
    step per iteration, and ignores `generator_steps`."""

    def terms(self) -> Objective:
        """All four loss terms of eq. 7 to 11."""
        return OBJECTIVES[self.objective]
