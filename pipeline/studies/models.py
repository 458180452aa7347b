"""The name of a model and of its answers, such as sci-4way-pose-seed1, with its parts.

A model answers queries with places. These answers may be registered to poses, and the poses of a
drive may be joined along its path; the results of each are rows of their own.
"""

from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class ModelName:
    """Identifies a model in the results table: method, variant, seed, whether it was posed."""

    method: str
    variant: str = ""
    """A method with some settings changed; empty for the method itself."""
    seed: int = 0
    """The seed of training: models with other seeds differ only in random draws."""
    posed: bool = False
    """Whether its answers were registered to poses; they count as a variant of their own."""
    path: str = ""
    """How the poses of a drive were joined, a file of conf/path; such answers are a variant too."""

    @property
    def family(self) -> str:
        """The method with its variant, whatever the seed: `sci-4way`, `sci-4way-pose`."""
        return "-".join(filter(None, (self.method, self.variant_of_answers)))

    @property
    def variant_of_answers(self) -> str:
        """The variant as the table of results has it: `4way-pose`, `pose-filter`."""
        pose = "pose" if self.posed else ""
        return "-".join(filter(None, (self.variant, pose, self.path)))

    @property
    def name(self) -> str:
        """The name of its artifacts: `sci-4way-seed1`."""
        return f"{self.family}-seed{self.seed}" if self.seed else self.family

    @property
    def plainer(self) -> list["ModelName"]:
        """The model itself, then without joined poses, then without poses: what to compare it as.

        Answers are compared with answers of the same kind, as far as another model has them.
        """
        single = replace(self, path="")
        return list(dict.fromkeys((self, single, replace(single, posed=False))))

    @property
    def columns(self) -> dict[str, Any]:
        """The columns that name it in the table of results."""
        return {"method": self.method, "variant": self.variant_of_answers, "seed": self.seed}
