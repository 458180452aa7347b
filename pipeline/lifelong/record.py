"""What a localiser answered of the asked days after each step of learning: the artifact of the
stage `lifelong`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.lifelong.steps import Step
from pipeline.matching.ranking import Rows

K = 25
"""Places ranked for each query."""


@dataclass(frozen=True)
class Record:
    """What a localiser answered of the asked days after each step."""

    columns: Mapping[str, NDArray[Any]]
    """As in schemas_lifelong."""
    steps: Sequence[Step]
    asked_ns: Sequence[int]
    """The first stamp of each asked day."""

    @classmethod
    def of(
        cls, steps: Iterator[Step], asked: Mapping[str, Rows], told: Callable[[str], None]
    ) -> Self:
        """Every day asked after every step."""
        xy_m = np.concatenate([views.world_T_anchor[:, :2, 3] for views in asked.values()])
        day = np.repeat(np.arange(len(asked)), [len(views.stamps_ns) for views in asked.values()])
        answers = []
        errors = []
        done = list[Step]()
        for step in steps:
            rankings = [step.localizer(views, K) for views in asked.values()]
            answers.append(np.concatenate([one.places[:, 0] for one in rankings]))
            errors.append(
                np.linalg.norm(np.concatenate([one.xy_m[:, 0] for one in rankings]) - xy_m, axis=1)
            )
            done.append(step)
            true = step.places.at(xy_m)
            told(
                f"{step.name}: {np.mean((answers[-1] == true)[true >= 0]):.3f} right of "
                f"{(true >= 0).sum()} seen"
            )
        true = done[-1].places.at(xy_m)
        known = np.array([step.places.at(xy_m) >= 0 for step in done])
        columns = {
            "right": (np.array(answers) == true) & (true >= 0),
            "error_m": np.array(errors),
            "known_from": np.where(known.any(axis=0), known.argmax(axis=0), -1),
            "day": day,
            "xy_m": xy_m,
            "place_xy_m": (last := done[-1]).places.grid.centre(last.places.cells),
            "newest_ns": last.newest_ns,
        }
        return cls(columns, done, [int(views.stamps_ns[0]) for views in asked.values()])

    @property
    def attrs(self) -> dict[str, Any]:
        """The other half of the artifact."""
        every = self.steps
        known = [len(step.places.cells) for step in every]
        return {
            "steps": [step.name for step in every],
            "places": known,
            "newest_ns": [int(step.newest_ns.max()) for step in every],
            "asked_ns": [*self.asked_ns],
            "bytes": [step.bytes for step in every],
            "counts": [dict(step.counts) for step in every],
        }

    def line(self) -> str:
        """What came out, in a line."""
        known = self.columns["known_from"] >= 0
        first, last = (float(self.columns["right"][step, known].mean()) for step in (0, -1))
        places = f"{len(self.steps)} steps to {len(self.steps[-1].places.cells)} places"
        return (
            f"{places}: of {known.sum()} queries that can be known {first:.3f} right at first, "
            f"{last:.3f} at last"
        )
