"""Models compared over cases, sequences, seeds and repeats: values picked from the table of results, never computed anew."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.errors import InputError
from pipeline.report.found import Found, deviation
from pipeline.studies.expansion import ModelName

ONE_SEED = 0.02
"""What another seed may do to a model of one seed: means over a simulated year of three seeds deviate by .003 to .016 for SCI
trained with one or two headings and for its ring."""


@dataclass(frozen=True)
class Kind:
    """A kind of case, its repeats taken together; as driven without a change."""

    change: str = ""
    level: float = 0.0
    shadow: bool = False


def label(kind: Kind) -> str:
    """A kind of case in a word or two, for legends."""
    if kind.change == "demolition":
        return f"{kind.level:g}° removed"
    if kind.change == "construction":
        walls = "1 wall" if kind.level == 1 else f"{kind.level:g} walls"
        return f"{walls}, shadow" if kind.shadow else walls
    return kind.change or "as driven"


@dataclass(frozen=True)
class Measure:
    """A number of the table, or the share of it that is left once the queries are altered."""

    protocol: str
    name: str
    title: str
    digits: int = 3
    relative: bool = False
    """As a share of the same model's, of the same seed and sequence, as driven."""


AUC = Measure("cells", "auc_top1", "AUC top-1 by cells")
KEPT = replace(AUC, title="AUC kept, by cells", relative=True)
RECALL = Measure("cells", "recall_at_1", "recall@1 by cells")
AUROC = Measure("cells", "auroc", "AUROC by cells")
FAR_AUC = Measure("distance", "auc_top1", "AUC top-1 by distance")
FAR = Measure("distance", "recall_at_1", "recall@1 by distance")
FAR_AUROC = Measure("distance", "auroc", "AUROC by distance")
OFF = Measure("distance", "median_heading_error_deg", "heading error [°]", 1)
WITHIN = Measure("distance", "heading_within_10deg", "within 10°")
MEASURES = (AUC, RECALL, AUROC, FAR_AUC, FAR, FAR_AUROC, OFF, WITHIN)


@dataclass(frozen=True)
class Margin:
    """By how much one model is ahead of another on the same sequences and repeats, in means over seeds."""

    value: float
    over_sequences: float
    number: int
    """Sequences compared."""
    clear: bool
    """Ahead, or behind, on every one of several sequences, and by more than the deviation over them and over either's seeds,
    or, of one seed, than another might differ by."""


@dataclass(frozen=True)
class Comparison:
    """The rows of some sequences and cases."""

    table: pd.DataFrame
    """Rows of the table of results; raises InputError for none."""
    n_way: Mapping[str, int] = field(default_factory=dict)
    """Model to the N of its N-way training."""

    def __post_init__(self) -> None:
        if self.table.empty:
            raise InputError("a comparison needs at least one row of the table of results")

    @cached_property
    def _rows(self) -> pd.DataFrame:
        """Only the rows that are compared, with the model's family."""
        wanted = self.table[self.table["number"].isin({one.name for one in MEASURES}) & (self.table["kind"] == "")]
        families = [ModelName(*names).family for names in zip(wanted["method"], wanted["variant"], strict=True)]
        return wanted.assign(model=families)

    @cached_property
    def _values(self) -> dict[tuple[object, ...], float]:
        columns = ["model", "seed", "sequence", "repeat", "change", "level", "shadow", "protocol", "number", "value"]
        return {tuple(key): value for *key, value in self._rows[columns].itertuples(index=False)}

    @cached_property
    def models(self) -> list[str]:
        """Methods and variants, in the order they come."""
        return list(dict.fromkeys(self._rows["model"]))

    @cached_property
    def sequences(self) -> list[str]:
        """In the order of their days since training."""
        days = dict(zip(self._rows["sequence"], self._rows["days"], strict=True))
        return sorted(days, key=lambda name: (days[name], name))

    @cached_property
    def kinds(self) -> list[Kind]:
        """As driven comes first."""
        found = dict.fromkeys(Kind(*key) for key in self._rows[["change", "level", "shadow"]].itertuples(index=False))
        return sorted(found, key=lambda kind: kind.change != "")

    @property
    def changes(self) -> list[Kind]:
        """All kinds but as driven."""
        return [kind for kind in self.kinds if kind.change]

    @cached_property
    def seeds(self) -> dict[str, int]:
        """How many each model has."""
        return {model: int(group["seed"].max()) + 1 for model, group in self._rows.groupby("model")}

    @cached_property
    def repeats(self) -> int:
        """The most that a kind of case has."""
        return int(self._rows["repeat"].max()) + 1

    def ways(self) -> dict[int, str]:
        """N to model, ascending, of the method with most models that were trained N ways."""
        of: dict[str, dict[int, str]] = {}
        for model, method in dict(zip(self._rows["model"], self._rows["method"], strict=True)).items():
            if model in self.n_way:
                of.setdefault(method, {})[self.n_way[model]] = model
        return dict(sorted(max(of.values(), key=len).items())) if of else {}

    def found(self, model: str, kind: Kind, measure: Measure) -> Found:
        """One number of one model in one kind of case."""
        values = np.full((self.seeds[model], len(self.sequences), self.repeats), np.nan)
        for seed, sequence, repeat in np.ndindex(*values.shape):
            where, of = (model, seed, self.sequences[sequence], repeat), (measure.protocol, measure.name)
            values[seed, sequence, repeat] = self._values.get((*where, kind.change, kind.level, kind.shadow, *of), np.nan)
        if not measure.relative:
            return Found(values)
        whole = self.found(model, Kind(), replace(measure, relative=False)).values[:, :, :1]
        return Found(np.divide(values, whole, out=np.full_like(values, np.nan), where=whole > 0))

    def ordered(self, kind: Kind, measure: Measure) -> list[str]:
        """The models, the largest number first, those without one last."""
        means = {model: self.found(model, kind, measure).mean for model in self.models}
        return sorted(self.models, key=lambda model: -np.nan_to_num(means[model], nan=-np.inf))

    def ahead(self, one: str, other: str, kind: Kind, measure: Measure) -> Margin:
        """Of one model over another."""
        ours, theirs = self.found(one, kind, measure), self.found(other, kind, measure)
        apart = ours.by_sequence - theirs.by_sequence
        apart = apart[np.isfinite(apart)]
        if not len(apart):
            return Margin(np.nan, np.nan, 0, False)
        value, around = float(apart.mean()), deviation(apart)
        noise = np.nanmax([around, *(ONE_SEED if np.isnan(one.over_seeds) else one.over_seeds for one in (ours, theirs))])
        same = bool((apart > 0).all() or (apart < 0).all())
        return Margin(value, around, len(apart), len(apart) > 1 and same and abs(value) > noise)
