"""AFL: place features learned by the joint adversarial game alone, which PFL stabilises (Yin et
al., IROS 2018; METHODS 5.1)."""

from dataclasses import dataclass

from pipeline.methods.pfl.features import FeatureMethod
from pipeline.methods.pfl.game import OBJECTIVES, Objective


@dataclass(frozen=True)
class Afl(FeatureMethod):
    """Adversarial feature learning."""

    def terms(self) -> Objective:
        """The joint discriminator's line and the generators'."""
        return OBJECTIVES["afl"]
