"""What the numbers show, as data: who is compared, by how much, and whether that is clear. Templates make the sentences."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One verdict."""

    kind: str
    """Its key in templates/words.yaml, which holds the sentence."""
    values: Mapping[str, Any]
    """What the sentence is filled with: names of models, differences, intervals, whether they are clear."""
