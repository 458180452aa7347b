"""Stage `perturbed`: draws the views of submaps whose points were changed on purpose.

A perturbation turns the robot, adds walls or removes buildings; each way in which it does so to all
submaps of a test sequence is a case. The stage reads scans and submaps and writes an artifact of
views a sequence, case after case. `localize` answers them beside the views unperturbed.
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
    """What is drawn: a file of conf/view."""
    perturbation: Any
    """What is done to the points before: a file of conf/perturbation."""
    scans: Path
    submaps: Path


@stage("perturbed")
def main(settings: Settings) -> str:
    def draw(sequence: str, folder: Path) -> str:
        """Draw one sequence's views in every case but `as driven`, which its own stage draws."""
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
