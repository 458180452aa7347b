"""A sequence's entry in the table of conf/world's yamls: which way it goes, and what makes it hard."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Self

from pipeline.errors import ConfigError
from pipeline.running.settings import check
from pipeline.world.driving.drive import OFFSET_CLIP_M


@dataclass(frozen=True)
class Entry:
    """What a sequence is wanted to be; all but its shares may be left out."""

    unseen: float
    """The share of its route that the training sequence leaves out; a scanner car's, of its second half against its first."""
    reversed: float
    """The share of the rest that it drives against the training sequence's direction."""
    events_per_km: float = 0.0
    """At least so many events in its year: the world's own, and further ones, none of which shows on the training day."""
    near_route: float = 1.0
    """The share of the further events near the training route."""
    lateral_m: float = 0.0
    """How far left of its usual line it drives; to the right below 0."""

    @classmethod
    def of(cls, sequence: str, words: Mapping[str, float]) -> Self:
        """From the table; raises ConfigError in one line."""
        group = f"world.sequences.{sequence}"
        try:
            entry = cls(**words)
        except TypeError:
            names = [field.name for field in fields(cls)]
            raise ConfigError(f"{group}: needs unseen and reversed, and takes {', '.join(names[2:-1])} and {names[-1]}") from None
        check(entry, group)
        for name in ("unseen", "reversed", "near_route"):
            if not 0 <= getattr(entry, name) <= 1:
                raise ConfigError(f"{group}.{name}={getattr(entry, name)}: expected a share from 0 to 1")
        if entry.events_per_km < 0:
            raise ConfigError(f"{group}.events_per_km={entry.events_per_km}: expected 0 or more")
        if abs(entry.lateral_m) > OFFSET_CLIP_M:
            raise ConfigError(f"{group}.lateral_m={entry.lateral_m}: expected at most {OFFSET_CLIP_M:g} m to either side")
        return entry
