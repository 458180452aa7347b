"""The days that a model of a study learns, and the localiser after each of them.

The stage `lifelong` runs the steps of one of three orders (METHODS 11.4):

- `days`: days with reference poses, one after the other;
- `streets`: the training day in parts;
- `self_training`: days without reference poses, which the model's site learns by itself.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.progress import Progress
from pipeline.lifelong.steps import Step, self_trained, streets, supervised
from pipeline.mapping.gathering import submap_points
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Rows
from pipeline.online.inputs import Scan
from pipeline.online.pack import Packing, Trained

Order = Literal["days", "streets", "self_training"]


def learned(
    order: Order,
    trained: Trained,
    later_days: Sequence[str],
    strategy: Any,
    method: Method,
    packing: Packing,
    scratch: Path,
    progress: Progress,
) -> Iterator[Step]:
    """The localiser after each step of an order, in which one model of a study learns.

    `trained` are the model and the artifacts of its first day; the artifacts of the `later_days`
    are beside them. `strategy` says how a step is learned (strategies.py). The first day is trained
    already, except in the order `streets`, which trains its first part here. For `self_training`,
    the model is first packed into a site, in the folder `scratch`.
    """
    if order == "self_training":
        site = scratch / "first.site"
        progress.tell(packing.pack(trained, site, progress))
        return self_trained(
            site, strategy, {name: drive(trained, name) for name in later_days}, progress
        )
    train = trained.train
    folder = trained.views.parent
    days = {name: Rows.read(folder / f"{name}.zarr") for name in (train, *later_days)}
    places = Places.of(store.read(trained.labels, schemas.Labels))
    if order == "streets":
        no_places = Places(places.grid, places.cells[:0])
        return supervised(method, strategy, streets(train, days[train]), no_places, None, progress)
    first_model = store.read_model(trained.model)
    return supervised(method, strategy, days, places, first_model, progress)


def drive(trained: Trained, sequence: str) -> list[Scan]:
    """The scans of a day in their order, for a site to localise; each submap is one scan.

    They have odometry, and true poses, which are only used to count errors. Points are read only
    when they are needed.
    """
    scans = store.read(trained.scans.parent / f"{sequence}.zarr", schemas.Scans)
    submaps = store.read(trained.submaps.parent / f"{sequence}.zarr", schemas.Submaps)
    odom_T_anchor = scans.load("odom_T_scan")[submaps.load("scans")]
    stamps_ns = submaps.load("stamps_ns").tolist()
    world_T_anchor = submaps.load("world_T_anchor")
    return [
        Scan(
            f"{sequence} {row}",
            stamps_ns[row],
            partial(_points, scans, submaps, row),
            odom_T_anchor[row],
            world_T_anchor[row],
        )
        for row in range(len(stamps_ns))
    ]


def _points(scans: schemas.Scans, submaps: schemas.Submaps, row: int) -> NDArray[np.float64]:
    """The points (n, 3) of one submap."""
    (points_m,) = submap_points(scans, submaps, slice(row, row + 1))
    return np.asarray(points_m, np.float64)
