"""Names of models: method, variant, seed, and how its answers were posed."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ModelName:
    """Identifies a model in the results table: method, variant, seed, whether it was posed."""

    method: str
    variant: str = ""
    seed: int = 0
    posed: bool = False
    """Its answers were registered, which makes them a variant of their own."""
    path: str = ""
    """A file of conf/path: how the poses of a drive were joined, which makes them a further
    variant."""

    @property
    def family(self) -> str:
        """A method or a variant of one, whatever the seed: `sci-4way`, `sci-4way-pose`."""
        return f"{self.method}-{self.answered}" if self.answered else self.method

    @property
    def answered(self) -> str:
        """The variant as the table of results has it: `4way-pose`, `pose-filter`."""
        return "-".join(filter(None, (self.variant, "pose" * self.posed, self.path)))

    @property
    def name(self) -> str:
        """The name of its artifacts: `sci-4way-seed1`."""
        return f"{self.family}-seed{self.seed}" if self.seed else self.family

    @property
    def columns(self) -> dict[str, Any]:  # of the table of results
        return {"method": self.method, "variant": self.answered, "seed": self.seed}
