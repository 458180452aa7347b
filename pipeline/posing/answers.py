"""Answers with poses: the ranking of a method, led by what was registered, and how new each query then looks (METHODS 9.6)."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.alterations import Case
from pipeline.errors import ConfigError
from pipeline.frames import Poses, yaw
from pipeline.grid import UNSEEN, Grid
from pipeline.matching.ranking import Ranking
from pipeline.posing.fix import Fix, Hypothesis
from pipeline.posing.verdict import PROMISES, Verdict
from pipeline.store import Artifact

OWN_KINDS = ("combined", "overlap")
"""Kinds of novelty that a fix adds: one minus the chance that it is right, and one minus its overlap."""
UNPLACED = 1.0
"""Cost from which the method's own answers follow those that were registered."""


@dataclass(frozen=True)
class Signs:
    """What speaks for each of q fixes: numbers that a verdict learns from."""

    overlap: NDArray[np.float64]
    structure: NDArray[np.float64]
    runner_up: NDArray[np.float64]
    spread_m: NDArray[np.float64]
    novelty: NDArray[np.float64]

    @classmethod
    def of(cls, fixes: Sequence[Fix], apart_m: float, ranking: Ranking) -> "Signs":
        """Of fixes and of the ranking that they came from, whose novelty in use is one of the signs."""
        none = Hypothesis(-1, np.eye(4), 0.0, 0.0, np.inf)
        first = [fix.hypotheses[0] if fix.hypotheses else none for fix in fixes]
        own = [(one.overlap, one.structure, fix.runner_up(apart_m), one.spread_m) for one, fix in zip(first, fixes, strict=True)]
        overlap, shares, runner_up, spread_m = np.array(own, np.float64).reshape(-1, 4).T
        return cls(overlap, shares, runner_up, spread_m, ranking.novelty[:, 0].astype(np.float64))

    def features(self) -> NDArray[np.float64]:
        """(q, 5) finite ones; the first is the overlap."""
        largest = np.finfo(np.float32).max
        spread = np.log10(self.spread_m.clip(1e-4, 1.0))
        lead, novelty = (self.overlap + self.structure) / 2 - self.runner_up, self.novelty.clip(-largest, largest)
        return np.stack([self.overlap, self.structure, lead, spread, novelty], axis=1)


def poses(fixes: Sequence[Fix]) -> Poses:
    """(q, 4, 4) of the best hypotheses; NaN without one."""
    none = np.full((4, 4), np.nan)
    return np.array([fix.hypotheses[0].world_T_query if fix.hypotheses else none for fix in fixes]).reshape(-1, 4, 4)


def posed(
    ranking: Ranking,
    fixes: Sequence[Fix],
    place_of: Callable[[NDArray[np.float64]], NDArray[np.int64]],
    chance: NDArray[np.float64],
) -> Ranking:
    """The ranking with its fixes first: positions, places (the cell that each lies in; −1 where training never went), headings.

    `place_of` gives the places (n,) of positions (n, 2); `chance` (q,) that each fix is right becomes the confidence.
    """
    places, costs, xy_m = ranking.places.copy(), ranking.costs.copy(), ranking.xy_m.copy()
    k = places.shape[1]
    for i, fix in enumerate(fixes):
        if not fix.hypotheses:
            continue
        own_m = np.array([one.world_T_query[:2, 3] for one in fix.hypotheses])
        every = np.r_[place_of(own_m), ranking.places[i]]
        first = np.sort(np.unique(every, return_index=True)[1])[:k]
        every_cost = np.r_[[1 - one.support for one in fix.hypotheses], UNPLACED + np.arange(k) / k]
        for column, whole in ((places, every), (costs, every_cost), (xy_m, np.r_[own_m, ranking.xy_m[i]])):
            column[i, : len(first)] = whole[first]
    overlap = np.array([fix.hypotheses[0].overlap if fix.hypotheses else 0.0 for fix in fixes])
    novelty = np.column_stack([1 - chance, 1 - overlap, ranking.novelty]).astype(np.float32)
    heading_deg = np.rad2deg(yaw(poses(fixes))).astype(np.float32)
    kinds = (*OWN_KINDS, *ranking.kinds)
    answered: dict[str, Any] = {"places": places, "costs": costs, "xy_m": xy_m, "heading_deg": heading_deg}
    return replace(ranking, **answered, novelty=novelty, kinds=kinds, confidence=chance.astype(np.float32))


@dataclass(frozen=True)
class Posing:
    """Writes the rankings of one model again, with poses."""

    verdict: Verdict
    labels: Artifact
    """Of the training day: its grid and places."""
    apart_m: float
    novelty: str
    """In use: one of OWN_KINDS."""
    wanted_precision: float
    lines: list[str] = field(default_factory=list)
    """What was done, a line a sequence."""

    def __post_init__(self) -> None:
        if self.novelty not in OWN_KINDS:
            raise ConfigError(f"novelty={self.novelty}: expected {' or '.join(OWN_KINDS)}")

    def write(self, path: Path, rankings: Artifact, fixes: Sequence[Fix]) -> None:
        """The fixes (q,) of the queries as driven, which are the first of a ranking's."""
        names = [one.name for one in fields(Ranking) if one.name != "kinds"]
        arrays = {name: np.asarray(rankings[name][: len(fixes)]) for name in names}
        ranking = Ranking(**arrays, kinds=tuple(rankings.attrs["kinds"]))
        chance = self.verdict.chance(Signs.of(fixes, self.apart_m, ranking).features())
        answered = posed(ranking, fixes, self.places, chance).by(self.novelty)
        own = self._reject_from((self.wanted_precision,)) | dict(zip(ranking.kinds, rankings.attrs["thresholds"], strict=True))
        promised = self._reject_from(PROMISES)[answered.kinds[0]]
        attrs: dict[str, object] = {"kinds": answered.kinds, "thresholds": [np.ravel(own[kind])[0] for kind in answered.kinds]}
        attrs |= {"promises": PROMISES, "promised": promised, "held_out": self.verdict.evidence.queries}
        cases = {"cases": [asdict(Case())], "wanted_precision": self.wanted_precision}
        with store.write(path, schemas.FIXES, **attrs, **cases) as out:
            for name in names:
                out.put(name, getattr(answered, name))
            out.put("turned_deg", np.zeros(len(fixes), np.float32))
            out.put("world_T_query", poses(fixes))
        taken = int((answered.novelty[:, 0].astype(float) < promised[1]).sum())
        without = sum(not fix.hypotheses for fix in fixes)
        said = f"{len(fixes) - without} poses of {len(fixes)} queries, {taken} with a promise of {PROMISES[1]}"
        self.lines.append(f"{path.stem}: {said}")

    def places(self, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The places (n,) of positions (n, 2)."""
        cells, attrs = self.labels.load("cells"), self.labels.attrs
        own = Grid(attrs["cell_m"], tuple(attrs["x_m"]), tuple(attrs["y_m"])).cell(xy_m)
        place = np.searchsorted(cells, own).clip(0, len(cells) - 1)
        return np.where(cells[place] == own, place, UNSEEN)

    def _reject_from(self, promises: tuple[float, ...]) -> dict[str, list[float]]:
        """For each of OWN_KINDS the novelty to reject from, for each promise."""
        features = self.verdict.evidence.features
        novelty = dict(zip(OWN_KINDS, (1 - self.verdict.chance(features), 1 - features[:, 0]), strict=True))
        return {kind: self.verdict.thresholds(values, promises) for kind, values in novelty.items()}
