"""Stage `perturbed`: draws the views of submaps whose points were perturbed on purpose.

A perturbation turns the robot, adds walls or removes buildings. Each way in which it changes all
submaps of a test sequence is a case. The stage reads scans and submaps, and writes one artifact of
views for each sequence, case after case. The stage `localize` answers them beside the unperturbed
views.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import schemas, store
from pipeline.views.perturbed import perturbed
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/perturbed.yaml."""

    view: Any
    """Draws the views: a file of conf/view."""
    perturbation: Any
    """Perturbs the points before they are drawn: a file of conf/perturbation."""
    scans: Path
    submaps: Path


@stage("perturbed")
def main(settings: Settings) -> str:
    def draw(sequence: str, folder: Path) -> str:
        """Write one sequence's views in all perturbed cases; `views` draws the unperturbed case."""
        name = f"{sequence}.zarr"
        cases = perturbed(
            store.read(settings.scans / name, schemas.Scans),
            store.read(settings.submaps / name, schemas.Submaps),
            settings.view,
            settings.perturbation,
        )
        rows_of_cases = list(cases.values())
        case_tables = [asdict(case) for case in cases]
        with store.draft(folder / name, settings.view.schema, cases=case_tables) as out:
            for rows in rows_of_cases:
                out.append("images", rows.images)
            for column in ("stamps_ns", "world_T_anchor"):
                out.put(column, np.concatenate([getattr(rows, column) for rows in rows_of_cases]))
        return f"{sequence}: {len(cases)} cases of {len(rows_of_cases[0].stamps_ns)} views"

    return each_sequence(settings, draw, "perturb")


if __name__ == "__main__":
    main()
