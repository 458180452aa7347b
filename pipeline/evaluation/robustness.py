"""How a model's answers bear what is done to the queries: the numbers of an evaluation for every case of an alteration."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.errors import ArtifactError
from pipeline.evaluation.counts import right
from pipeline.evaluation.judgement import asked
from pipeline.evaluation.numbers import NUMBERS, numbers
from pipeline.evaluation.protocols import PROTOCOLS, Distance, by_cells
from pipeline.frames import Poses
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Ranking
from pipeline.schemas import ROBUSTNESS
from pipeline.store import Artifact

TOLD = ("recall_at_1", "auc_top1", "auroc", "median_error_m", "median_heading_error_deg")


@dataclass(frozen=True)
class Robustness:
    """One model on one test sequence of q queries, in c cases (schemas.ROBUSTNESS says what each array is)."""

    cases: tuple[Case, ...]
    days: int
    model: str
    numbers: NDArray[np.float64]  # (c, protocol, number)
    answer: NDArray[np.int64]  # (c, q)
    right: NDArray[np.bool_]  # (c, protocol, q)
    novelty: NDArray[np.float32]  # (c, q)
    turned_deg: NDArray[np.float32]  # (c, q)
    heading_error_deg: NDArray[np.float64]  # (c, q)
    error_m: NDArray[np.float64]  # (c, q)
    seen: NDArray[np.bool_]  # (protocol, q)
    unseen: NDArray[np.bool_]  # (protocol, q)
    xy_m: NDArray[np.float64]  # (q, 2)

    def number(self, case: int, protocol: str, name: str) -> float:
        """One of NUMBERS by one of PROTOCOLS; NaN where there is none."""
        return float(self.numbers[case, PROTOCOLS.index(protocol), NUMBERS.index(name)])

    def of(self, change: str, level: float | None = None, shadow: bool | None = None) -> list[int]:
        """The cases of one change, maybe of one level, with or without shadow."""
        return [
            number
            for number, case in enumerate(self.cases)
            if case.change == change and level in (None, case.level) and shadow in (None, case.shadow)
        ]

    def told(self) -> list[dict[str, Any]]:
        """The few numbers of each case by protocol, as JSON has them: None where there is none."""
        return [{"case": asdict(case), **{by: self._few(i, by) for by in PROTOCOLS}} for i, case in enumerate(self.cases)]

    def _few(self, case: int, protocol: str) -> dict[str, float | None]:
        values = {name: self.number(case, protocol, name) for name in TOLD}
        return {name: value if np.isfinite(value) else None for name, value in values.items()}

    def attrs(self) -> dict[str, Any]:
        """The attributes of its artifact."""
        names = {"numbers": list(NUMBERS), "protocols": list(PROTOCOLS), "cases": [asdict(case) for case in self.cases]}
        return {**names, "days": self.days, "model": self.model}

    @classmethod
    def read(cls, artifact: Artifact) -> Self:
        """From a `robustness` artifact."""
        for name, expected in (("protocols", PROTOCOLS), ("numbers", NUMBERS)):
            if tuple(artifact.attrs[name]) != expected:
                raise ArtifactError(f"{artifact.path}: its {name} are not today's; `dvc repro` it")
        cases = tuple(Case(**case) for case in artifact.attrs["cases"])
        arrays = {name: artifact.load(name) for name in ROBUSTNESS.columns}
        return cls(cases, int(artifact.attrs["days"]), str(artifact.attrs["model"]), **arrays)


def judge(
    rankings: Mapping[Case, Ranking],
    turned_world_T_anchor: Sequence[Poses],
    reject_from: Sequence[float],
    labels: Labels,
    world_T_anchor: Poses,
    days: int,
    distance: Distance,
    model: str,
) -> Robustness:
    """Judge the rankings of each case of the same q queries against their labels and poses (q, 4, 4).

    `turned_world_T_anchor` are the poses of each case, which differ from the ones that were driven by a turn at most.
    """
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name, column in ROBUSTNESS.columns.items() if column.dims[0] == "case"}
    xy_m, everyone = world_T_anchor[:, :2, 3].astype(np.float64), np.ones((1, len(world_T_anchor)))
    for ranking, poses in zip(rankings.values(), turned_world_T_anchor, strict=True):
        turn = np.linalg.inv(world_T_anchor) @ poses
        turned_deg = np.rad2deg(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
        met_deg = 180 - (180 - labels.nearest_turn_deg - turned_deg) % 360
        queries = asked(ranking, reject_from, replace(labels, nearest_turn_deg=met_deg), poses)
        truths = (
            by_cells(ranking.places, labels.places, labels.oracle),
            distance.truth(ranking.xy_m, xy_m, labels.nearest_m),
        )
        found = [[value.item() for value in numbers(truth, queries, everyone).values()] for truth in truths]
        told = {
            "numbers": np.array(found),
            "answer": ranking.places[:, 0],
            "right": np.stack([right(truth, 1) for truth in truths]),
            "novelty": queries.novelty[:, 0],
            "turned_deg": turned_deg.astype(np.float32),
            "heading_error_deg": queries.heading_error_deg,
            "error_m": queries.error_m,
        }
        for name, column in told.items():
            columns[name].append(column)
    return Robustness(
        tuple(rankings),
        days,
        model,
        **{name: np.stack(parts) for name, parts in columns.items()},
        seen=np.stack([truth.seen for truth in truths]),
        unseen=np.stack([truth.unseen for truth in truths]),
        xy_m=xy_m,
    )
