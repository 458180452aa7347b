"""The section on paper 2's protocol: a sequence matched with itself, from headings between those of the reference."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import schemas, store
from pipeline.evaluation.viewpoints import NUMBERS, Judged
from pipeline.report import viewpoint_tables
from pipeline.report.figures import birdview, learning, viewpoints
from pipeline.report.figures.style import save
from pipeline.report.learned import Learned
from pipeline.report.render import anchor
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study
from pipeline.studies.expansion import models_of, on_bird_views
from pipeline.views.birdview import BirdView
from pipeline.views.mapped import MappedViews


def section(study: Study, folder: Path, view: BirdView) -> Section:
    """Draw paper 2's figures into `folder`; `view` is what its methods look at."""
    listed = on_bird_views(study.words["methods"])
    methods = {one["name"]: [model.name for model in models_of({**one, "variants": {}})] for one in listed}
    judged = {
        (method, path.stem): [
            Judged.read(store.read(path.parents[1] / model / path.name, schemas.VIEWPOINTS)) for model in methods[method]
        ]
        for method in methods
        for path in sorted(study.find("viewpoints", "_", method).parent.glob("*.zarr"))
    }
    sequences, first = list(dict.fromkeys(sequence for _, sequence in judged)), next(iter(judged.values()))[0]
    shown = [Illustration("birdview", _mapping(study, folder, view, sequences[0]), {"sequence": sequences[0]})]
    for sequence in sequences:
        group = {method: seeds for (method, where), seeds in judged.items() if where == sequence}
        path = save(viewpoints.precision_recall(group, sequence, study.simulated), folder / f"viewpoints_{sequence}.svg")
        shown.append(Illustration("viewpoint_curves", path, {"sequence": sequence}))
    every = {
        method: np.concatenate([np.stack([one.values for one in seeds]) for (name, _), seeds in judged.items() if name == method])
        for method in methods
    }
    values = {(method, number): found[:, :, i] for method, found in every.items() for i, number in enumerate(NUMBERS)}
    figure = viewpoints.indices(values, first.headings_deg.tolist(), first.correct_m, study.simulated)
    shown.append(Illustration("viewpoint_indices", save(figure, folder / "viewpoints_indices.svg"), {}))
    of_first = {name: seeds[0] for (name, where), seeds in judged.items() if where == sequences[0]}
    if pictures := {name: (one.pictures, one.reconstructed) for name, one in of_first.items() if len(one.reconstructed)}:
        path = save(learning.reconstructions(pictures, study.simulated), folder / "viewpoints_reconstructions.svg")
        shown.append(Illustration("reconstructions", path, {"sequence": sequences[0]}))
    curves = {name: [Learned.read(study.find("train", model=model)).curves for model in seeds] for name, seeds in methods.items()}
    if drawn := learning.collapse(curves, study.simulated):
        shown.append(Illustration("collapse", save(drawn, folder / "viewpoints_collapse.svg"), {}))
    over = (viewpoint_tables.over(study, seeds=False), viewpoint_tables.over(study, seeds=True))
    every_one = (*(one for one in over if one), *(viewpoint_tables.every_heading(study, number) for number in NUMBERS))
    step_deg = 360 / len(first.headings_deg)
    about: dict[str, Any] = {"study": study, "step_deg": step_deg, "correct_m": first.correct_m, "length": first.length}
    sources = (f"{study.artifacts.name}/viewpoints/{study.name}/{study.grid}",)
    name = anchor(study.name, study.grid, "viewpoints")
    return Section(name, "viewpoints", "studies", about, (), tuple(shown), every_one, True, sources)


def _mapping(study: Study, folder: Path, view: BirdView, sequence: str) -> Path:
    """How the middle one of a sequence's submaps becomes a bird-view."""
    views = MappedViews(study.artifact("scans", sequence), study.artifact("submaps", sequence), view)
    points, grown, standing = next(islice(views.maps(), len(views) // 2, None))
    return save(birdview.bird_view(points, grown, standing, view, study.simulated), folder / "viewpoints_mapping.svg")
