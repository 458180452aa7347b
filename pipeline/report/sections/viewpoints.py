"""The section on paper 2's protocol: a sequence matched with itself from other headings."""

from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.core import schemas, store
from pipeline.evaluation.viewpoints import NUMBERS, ViewpointMatches
from pipeline.report import viewpoint_tables
from pipeline.report.figures import birdview, viewpoints
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.section import Section
from pipeline.report.study import Study, TrainingRecord
from pipeline.views.birdview import BirdView
from pipeline.views.mapped import MappedViews


def section(study: Study, folder: Path, view: BirdView) -> Section:
    """Draw paper 2's figures into `folder`; `view` is the bird-view that the methods look at."""
    methods = {
        family: [model.name for model in models]
        for method in study.settings.bird_view_methods
        for family, models in method.families.items()
    }
    judgements_on: dict[
        str, dict[str, list[ViewpointMatches]]
    ] = {}  # by sequence and method, one of each seed
    for method, models in methods.items():
        for artifact in sorted(study.find("viewpoints", "_", method).parent.glob("*.zarr")):
            seed_paths = (artifact.parents[1] / model / artifact.name for model in models)
            judgements = [store.read(path, ViewpointMatches) for path in seed_paths]
            judgements_on.setdefault(artifact.stem, {})[method] = judgements
    sequence, first_group = next(iter(judgements_on.items()))
    first = next(iter(first_group.values()))[0]
    illustrations = [
        illustrate(
            "birdview",
            _mapping(study, view, sequence),
            study,
            folder,
            name="viewpoints_mapping",
            sequence=sequence,
        )
    ]
    for day, group in judgements_on.items():
        figure = viewpoints.precision_recall(group, day)
        illustrations.append(
            illustrate(
                "viewpoint_curves", figure, study, folder, name=f"viewpoints_{day}", sequence=day
            )
        )
    values_of_method = {
        method: np.stack(
            [
                judgement.values
                for group in judgements_on.values()
                for judgement in group.get(method, ())
            ]
        )
        for method in methods
    }
    values = {
        (method, number): stacked[:, :, i]
        for method, stacked in values_of_method.items()
        for i, number in enumerate(NUMBERS)
    }
    figure = viewpoints.indices(values, first.headings_deg.tolist(), first.correct_m)
    illustrations.append(
        illustrate("viewpoint_indices", figure, study, folder, name="viewpoints_indices")
    )
    with_pictures = {
        name: seeds[0] for name, seeds in first_group.items() if len(seeds[0].reconstructed)
    }
    if with_pictures:
        figure = viewpoints.reconstructions(
            {
                name: (judgement.pictures, judgement.reconstructed)
                for name, judgement in with_pictures.items()
            }
        )
        illustrations.append(
            illustrate(
                "reconstructions",
                figure,
                study,
                folder,
                name="viewpoints_reconstructions",
                sequence=sequence,
            )
        )
    curves = {
        name: [TrainingRecord.read(study.find("train", model=model)).curves for model in seeds]
        for name, seeds in methods.items()
    }
    if collapse := viewpoints.collapse(curves):
        illustrations.append(
            illustrate("collapse", collapse, study, folder, name="viewpoints_collapse")
        )
    words = {
        "study": study,
        "correct_m": first.correct_m,
        "length": first.length,
        "step_deg": 360 / len(first.headings_deg),
    }
    return Section(
        anchor(study.name, study.grid, "viewpoints"),
        "viewpoints",
        values=words,
        illustrations=illustrations,
        tables=[
            *viewpoint_tables.over(study),
            *(viewpoint_tables.every_heading(study, number) for number in NUMBERS),
        ],
        sources=[study.folder("viewpoints", study.grid)],
    )


def _mapping(study: Study, view: BirdView, sequence: str) -> Figure:
    """How the middle submap of a sequence becomes a bird-view."""
    views = MappedViews(
        study.artifact(schemas.Scans, "scans", sequence),
        study.artifact(schemas.Submaps, "submaps", sequence),
        view,
    )
    points, octree_map, odom_T_vehicle = next(islice(views.maps(), len(views) // 2, None))
    return birdview.bird_view(points, octree_map, odom_T_vehicle, view)
