"""PFL: place features that two discriminators and two cycles learn together, which keeps them
stable (Yin et al., IROS 2018).

"Stabilize an Unsupervised Feature Learning for LiDAR-based Place Recognition"; METHODS 5.
"""

from dataclasses import dataclass
from typing import Literal

from pipeline.methods.pfl.features import FeatureMethod
from pipeline.methods.pfl.game import OBJECTIVES, Objective


@dataclass(frozen=True)
class Pfl(FeatureMethod):
    """Place feature learning, with the objective of the paper's text, of its authors' code, or
    between the two."""

    objective: Literal["least_squares", "bce", "paper", "author_code", "both_fakes"] = (
        "least_squares"
    )
    """See pipeline.methods.pfl.game; `least_squares` and `bce` have the code's weights and the
    paper's terms. `paper` alone is the paper as written: its one step an iteration takes the place
    of `generator_steps`."""

    def terms(self) -> Objective:
        """All four of eq. 7 to 11."""
        return OBJECTIVES[self.objective]
