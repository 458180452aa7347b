"""Answers with poses: the ranking of a method, led by what was registered, and how new each query then looks (METHODS 9.6)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.errors import ConfigError
from pipeline.frames import yaw
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.posing.fix import Fix, poses
from pipeline.posing.verdict import PROMISES, Verdict, features
from pipeline.store import Artifact

OWN_KINDS = ("fix", "overlap")
"""Kinds of novelty that a fix adds: one minus the chance that it is right, and one minus its overlap."""
MISSING = {"places": -1, "costs": np.inf, "xy_m": np.nan, "heading_deg": np.nan}
"""An answer that is none, column by column."""
UNREGISTERED = 1.0
"""Cost from which the method's own answers follow those that were registered, whose cost is their spread in metres."""


def posed(ranking: Ranking, fixes: Sequence[Fix], places: Places, chance: NDArray[np.float64]) -> Ranking:
    """The ranking with its fixes first: positions, headings, places (the cell that each lies in; −1 where training never went).

    The chance (q,) that each fix is right becomes the confidence. A place is answered once; what is then missing of k is place −1
    at an infinite cost.
    """
    k = ranking.places.shape[1]
    answers = {name: getattr(ranking, name).copy() for name in ("places", "costs", "xy_m", "heading_deg")}
    for i, fix in enumerate(fixes):
        if not fix.hypotheses:
            continue
        own = np.array([one.world_T_query for one in fix.hypotheses])
        xy_m, spreads_m = own[:, :2, 3], [one.alignment.spread_m for one in fix.hypotheses]
        answers["costs"][i] = UNREGISTERED + np.arange(k) / k
        lead(answers, i, {"places": places.at(xy_m), "costs": spreads_m, "xy_m": xy_m, "heading_deg": np.rad2deg(yaw(own))})
    overlap = np.array([fix.alignment.overlap for fix in fixes])
    novelty = np.column_stack([1 - chance, 1 - overlap, ranking.novelty]).astype(np.float32)
    return replace(ranking, **answers, novelty=novelty, kinds=(*OWN_KINDS, *ranking.kinds), confidence=chance.astype(np.float32))


def lead(answers: Mapping[str, NDArray[Any]], row: int, first: Mapping[str, Any]) -> None:
    """Put the answers `first`, likeliest first, before the k of a row; a place is answered once, what is then missing is −1."""
    every = {name: np.concatenate([first[name], answers[name][row]]) for name in MISSING}
    k = answers["places"].shape[1]
    kept = np.sort(np.unique(every["places"], return_index=True)[1])[:k]
    for name, missing in MISSING.items():
        answers[name][row] = missing
        answers[name][row, : len(kept)] = every[name][kept]


@dataclass(frozen=True)
class Posing:
    """Writes the rankings of one model again, with poses."""

    verdict: Verdict
    places: Places
    novelty: str
    """In use: one of OWN_KINDS."""
    wanted_precision: float
    clear_m: float
    """Below this spread the search ended."""

    def __post_init__(self) -> None:
        if self.novelty not in OWN_KINDS:
            raise ConfigError(f"novelty={self.novelty}: expected {' or '.join(OWN_KINDS)}")

    def write(self, path: Path, rankings: Artifact, fixes: Sequence[Fix]) -> str:
        """The fixes (q,) of a ranking's queries, in all its cases; returns what was done, in a line."""
        names = [one.name for one in fields(Ranking) if one.name != "kinds"]
        arrays = {name: rankings.load(name) for name in names}
        ranking = Ranking(**arrays, kinds=tuple(rankings.attrs["kinds"]))
        answered = posed(ranking, fixes, self.places, self.verdict.chance(features(fixes))).by(self.novelty)
        thresholds = {kind: self._reject_from(kind, self.wanted_precision) for kind in OWN_KINDS}
        thresholds |= dict(zip(ranking.kinds, rankings.attrs["thresholds"], strict=True))
        promised = [self._reject_from(self.novelty, promise) for promise in PROMISES]
        rejection = {"kinds": answered.kinds, "thresholds": [thresholds[kind] for kind in answered.kinds]}
        verdict = {"promises": PROMISES, "promised": promised, "held_out": self.verdict.evidence.queries, "clear_m": self.clear_m}
        cases = {"cases": rankings.attrs["cases"], "wanted_precision": self.wanted_precision}
        with store.write(path, schemas.FIXES, **rejection, **verdict, **cases) as out:
            for name in names:
                out.put(name, getattr(answered, name))
            out.put("turned_deg", rankings.load("turned_deg"))
            out.put("world_T_query", poses(fixes))
            out.put("covariance", np.array([fix.alignment.covariance for fix in fixes]).reshape(-1, 6, 6))
        accepted, found = answered.novelty[:, 0].astype(float) < promised[1], sum(bool(fix.hypotheses) for fix in fixes)
        return f"{path.stem}: {found} poses of {len(fixes)} queries, {accepted.sum()} with a promise of {PROMISES[1]}"

    def _reject_from(self, kind: str, precision: float) -> float:
        """The novelty of one of OWN_KINDS to reject from, to keep this precision."""
        known = self.verdict.evidence.features
        return self.verdict.threshold(1 - (known[:, 0] if kind == "overlap" else self.verdict.chance(known)), precision)
