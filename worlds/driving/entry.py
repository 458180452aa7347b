"""The settings of one simulated sequence in the yamls of conf/world: its route, and how hard it is
to localise on it.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Self

from pipeline.core.errors import ConfigError
from pipeline.core.settings import NotNegative, Share, check
from worlds.driving.drive import OFFSET_CLIP_M


@dataclass(frozen=True)
class Entry:
    """The settings of one simulated sequence; only `unseen` and `reversed` are required."""

    unseen: Share
    """Share of its route that the training sequence does not drive. For a scanner car, whose second
    half meets the first again: the share of the second half."""
    reversed: Share
    """Share of the rest of its route that it drives opposite to the training sequence."""
    events_per_km: NotNegative = 0.0
    """Least number of buildings built or demolished per km of route. If the world has fewer,
    further ones are added, which are invisible on the training day."""
    near_route: Share = 1.0
    """Share of these further events that are near the training route."""
    lateral_m: float = 0.0
    """Offset to the left of its usual line; negative ones are to the right."""

    @classmethod
    def of(cls, sequence: str, settings: Mapping[str, float]) -> Self:
        """Make the entry from its settings in the yaml; raises ConfigError if they are wrong."""
        group = f"world.sequences.{sequence}"
        try:
            entry = cls(**settings)
        except TypeError:
            optional = [field.name for field in fields(cls) if field.default is not MISSING]
            raise ConfigError(
                f"{group}: needs unseen and reversed, and takes {', '.join(optional[:-1])} and "
                f"{optional[-1]}"
            ) from None
        check(entry, group)
        if abs(entry.lateral_m) > OFFSET_CLIP_M:
            raise ConfigError(
                f"{group}.lateral_m={entry.lateral_m}: expected at most {OFFSET_CLIP_M:g} m to "
                "either side"
            )
        return entry
