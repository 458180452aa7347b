"""Submaps of some test sequences → views of them in every case of an alteration: turned, with walls
added or parts missing."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import schemas, store
from pipeline.views.altered import altered
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/altered.yaml."""

    view: Any
    alteration: Any
    scans: Path
    submaps: Path


@stage("altered")
def main(settings: Settings) -> str:
    def draw(sequence: str, folder: Path) -> str:
        """Draw the views of one sequence in every case but the one as driven.

        The stage of the view draws that one.
        """
        name = f"{sequence}.zarr"
        cases = altered(
            store.read(settings.scans / name, schemas.Scans),
            store.read(settings.submaps / name, schemas.Submaps),
            settings.view,
            settings.alteration,
        )
        listed = [asdict(case) for case in cases]
        with store.draft(folder / name, settings.view.schema, cases=listed) as out:
            for rows in cases.values():
                out.append("images", rows.images)
            for column in ("stamps_ns", "world_T_anchor"):
                out.put(column, np.concatenate([getattr(rows, column) for rows in cases.values()]))
        return (
            f"{sequence}: {len(cases)} cases of {len(next(iter(cases.values())).stamps_ns)} views"
        )

    return each_sequence(settings, draw, "alter")


if __name__ == "__main__":
    main()
