"""The settings of one simulated sequence in the yamls of conf/world: its route, and how hard it is
to localize on."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Self

from pipeline.core.errors import ConfigError
from pipeline.core.settings import NotNegative, Share, check
from pipeline.world.driving.drive import OFFSET_CLIP_M


@dataclass(frozen=True)
class Entry:
    """The settings of one simulated sequence; all but `unseen` and `reversed` are optional."""

    unseen: Share
    """The share of its route outside that of the training sequence; for a scanner car, of its
    second half outside its first."""
    reversed: Share
    """The share of the rest that it drives opposite to the training sequence."""
    events_per_km: NotNegative = 0.0
    """At least this many events per km of route: if the world has fewer, further ones are added,
    invisible on the training day."""
    near_route: Share = 1.0
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
