"""The settings of one sequence in the yamls of conf/world: its route, and how difficult it is."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Self

from pipeline.core.errors import ConfigError
from pipeline.core.settings import check
from pipeline.world.driving.drive import OFFSET_CLIP_M


@dataclass(frozen=True)
class Entry:
    """The settings of a sequence; all but `unseen` and `reversed` are optional."""

    unseen: float
    """The share of its route outside that of the training sequence; for a scanner car, of its
    second half outside its first."""
    reversed: float
    """The share of the rest that it drives opposite to the training sequence."""
    events_per_km: float = 0.0
    """Minimum of events in its year: those of the world, and further ones, which are invisible on
    the training day."""
    near_route: float = 1.0
    """The share of the further events near the training route."""
    lateral_m: float = 0.0
    """Offset to the left of its usual line; negative to the right."""

    @classmethod
    def of(cls, sequence: str, settings: Mapping[str, float]) -> Self:
        """The entry from its settings in the yaml; raises ConfigError."""
        group = f"world.sequences.{sequence}"
        try:
            entry = cls(**settings)
        except TypeError:
            names = [field.name for field in fields(cls)]
            raise ConfigError(
                f"{group}: needs unseen and reversed, and takes {', '.join(names[2:-1])} and "
                f"{names[-1]}"
            ) from None
        check(entry, group)
        for name in ("unseen", "reversed", "near_route"):
            if not 0 <= getattr(entry, name) <= 1:
                raise ConfigError(
                    f"{group}.{name}={getattr(entry, name)}: expected a share from 0 to 1"
                )
        if entry.events_per_km < 0:
            raise ConfigError(f"{group}.events_per_km={entry.events_per_km}: expected 0 or more")
        if abs(entry.lateral_m) > OFFSET_CLIP_M:
            raise ConfigError(
                f"{group}.lateral_m={entry.lateral_m}: expected at most {OFFSET_CLIP_M:g} m to "
                "either side"
            )
        return entry
