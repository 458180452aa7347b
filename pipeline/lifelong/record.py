"""Records what a localiser answers after each step of learning: the artifact of `lifelong`."""

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
    """A localiser's answers to all query days after each step of learning."""

    columns: Mapping[str, NDArray[Any]]
    """As in schemas_lifelong."""
    steps: Sequence[Step]
    asked_ns: Sequence[int]
    """The first stamp of each asked day."""

    @classmethod
    def of(
        cls, steps: Iterator[Step], queries: Mapping[str, Rows], report_line: Callable[[str], None]
    ) -> Self:
        """Localise all query days after every step; `report_line` is called with a line a step."""
        xy_m = np.concatenate([views.world_T_anchor[:, :2, 3] for views in queries.values()])
        day = np.repeat(
            np.arange(len(queries)), [len(views.stamps_ns) for views in queries.values()]
        )
        answers = []
        errors = []
        done_steps = list[Step]()
        for step in steps:
            rankings = [step.localizer(views, K) for views in queries.values()]
            answers.append(np.concatenate([ranking.places[:, 0] for ranking in rankings]))
            errors.append(
                np.linalg.norm(
                    np.concatenate([ranking.xy_m[:, 0] for ranking in rankings]) - xy_m, axis=1
                )
            )
            done_steps.append(step)
            true = step.places.at(xy_m)
            report_line(
                f"{step.name}: {np.mean((answers[-1] == true)[true >= 0]):.3f} right of "
                f"{(true >= 0).sum()} seen"
            )
        true = done_steps[-1].places.at(xy_m)
        is_known = np.array([step.places.at(xy_m) >= 0 for step in done_steps])
        columns = {
            "right": (np.array(answers) == true) & (true >= 0),
            "error_m": np.array(errors),
            "known_from": np.where(is_known.any(axis=0), is_known.argmax(axis=0), -1),
            "day": day,
            "xy_m": xy_m,
            "place_xy_m": (last_step := done_steps[-1]).places.grid.centre(last_step.places.cells),
            "newest_ns": last_step.newest_ns,
        }
        return cls(columns, done_steps, [int(views.stamps_ns[0]) for views in queries.values()])

    @property
    def attrs(self) -> dict[str, Any]:
        """The attributes of the artifact."""
        steps = self.steps
        place_counts = [len(step.places.cells) for step in steps]
        return {
            "steps": [step.name for step in steps],
            "places": place_counts,
            "newest_ns": [int(step.newest_ns.max()) for step in steps],
            "asked_ns": [*self.asked_ns],
            "bytes": [step.bytes for step in steps],
            "counts": [dict(step.counts) for step in steps],
        }

    def line(self) -> str:
        """Summarise the results in a line: the share of right answers at first and at last."""
        knowable = self.columns["known_from"] >= 0
        first, last = (float(self.columns["right"][step, knowable].mean()) for step in (0, -1))
        places = f"{len(self.steps)} steps to {len(self.steps[-1].places.cells)} places"
        return (
            f"{places}: of {knowable.sum()} queries that can be known {first:.3f} right at first, "
            f"{last:.3f} at last"
        )
