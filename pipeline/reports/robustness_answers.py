"""How every model of a study bore an alteration: each number of each, in order, and one model against another."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.alterations import AS_DRIVEN, Case
from pipeline.errors import InputError
from pipeline.evaluation.robustness import Robustness
from pipeline.reports.robustness_numbers import Found, Margin, Measure, deviation

PLAIN_WAY = 2
"""SCI's own augmentation, forward and reversed, that a model without an N in its name has (METHODS 2.5)."""

ONE_SEED = 0.02
"""What chance may do to a model of one seed: means over a simulated year of three seeds deviate by .003 to .016 for SCI learned
from one or two headings and for its ring; more for models that have hardly learned anything."""


@dataclass(frozen=True)
class Answers:
    """How every model of a study bore an alteration."""

    judged: Mapping[str, Sequence[Mapping[str, Robustness]]]
    """Model to its seeds, each of sequence to Robustness."""

    def __post_init__(self) -> None:
        if not any(seed for seeds in self.judged.values() for seed in seeds):
            raise InputError("a section on robustness needs at least one judged sequence")

    @property
    def models(self) -> list[str]:
        """In the order they come."""
        return list(self.judged)

    @cached_property
    def sequences(self) -> list[str]:
        """In the order of their days since training."""
        days = {name: one.days for seeds in self.judged.values() for seed in seeds for name, one in seed.items()}
        return sorted(days, key=lambda name: (days[name], name))

    @cached_property
    def kinds(self) -> list[Case]:
        """The cases, repeats of one taken together; as driven comes first."""
        every = (one for seeds in self.judged.values() for seed in seeds for one in seed.values())
        return list(dict.fromkeys(replace(case, repeat=0) for one in every for case in one.cases))

    @property
    def changes(self) -> list[Case]:
        """All kinds but as driven."""
        return [kind for kind in self.kinds if kind.change != AS_DRIVEN]

    @property
    def seeds(self) -> int:
        """The most that a model has."""
        return max(map(len, self.judged.values()))

    @cached_property
    def repeats(self) -> int:
        """The most that a kind of case has."""
        every = (one for seeds in self.judged.values() for seed in seeds for one in seed.values())
        return 1 + max(case.repeat for one in every for case in one.cases)

    def found(self, model: str, kind: Case, measure: Measure) -> Found:
        """One number of one model in one kind of case."""
        seeds = self.judged[model]
        values = np.full((len(seeds), len(self.sequences), self.repeats), np.nan)
        for i, seed in enumerate(seeds):
            for j, sequence in enumerate(self.sequences):
                if one := seed.get(sequence):
                    told = [
                        one.number(case, measure.protocol, measure.name) for case in one.of(kind.change, kind.level, kind.shadow)
                    ]
                    values[i, j, : len(told)] = told
        if not measure.relative:
            return Found(values)
        whole = self.found(model, Case(), replace(measure, relative=False)).values[:, :, :1]
        return Found(np.divide(values, whole, out=np.full_like(values, np.nan), where=whole > 0))

    def ordered(self, kind: Case, measure: Measure) -> list[str]:
        """The models, the largest number first, those without one last."""
        means = {model: self.found(model, kind, measure).mean for model in self.judged}
        return sorted(self.judged, key=lambda model: -np.nan_to_num(means[model], nan=-np.inf))

    def ahead(self, one: str, other: str, kind: Case, measure: Measure, other_kind: Case | None = None) -> Margin:
        """Of one model over another, or over another kind of case."""
        ours, theirs = self.found(one, kind, measure), self.found(other, other_kind or kind, measure)
        apart = ours.by_sequence - theirs.by_sequence
        apart = apart[np.isfinite(apart)]
        if not len(apart):
            return Margin(np.nan, np.nan, 0, False)
        value, around = float(apart.mean()), deviation(apart)
        chance = [found.over_seeds for found in (ours, theirs)]
        noise = np.nanmax([around, *(ONE_SEED if np.isnan(seeds) else seeds for seeds in chance)])
        same = bool((apart > 0).all() or (apart < 0).all())
        return Margin(value, around, len(apart), len(apart) > 1 and same and abs(value) > noise)

    def ways(self, family: str = "sci") -> dict[int, str]:
        """N to the model of a family that learned each image turned N ways, ascending."""
        found = {PLAIN_WAY: family} if family in self.judged else {}
        for model in self.judged:
            if match := re.fullmatch(rf"{re.escape(family)}-(\d+)way", model):
                found[int(match[1])] = model
        return dict(sorted(found.items()))
