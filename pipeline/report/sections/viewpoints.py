"""The section on paper 2's protocol: a sequence matched with itself from other headings."""

from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.core import schemas, store
from pipeline.evaluation.viewpoints import NUMBERS, ViewpointMatches
from pipeline.report import tables
from pipeline.report.figures import viewpoints, views
from pipeline.report.section import Section, illustrate, section_of
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
    # by sequence and method, one of each seed
    judgements: dict[str, dict[str, list[ViewpointMatches]]] = {}
    for method, models in methods.items():
        for artifact in sorted(study.find("viewpoints", "_", method).parent.glob("*.zarr")):
            judgements.setdefault(artifact.stem, {})[method] = [
                store.read(artifact.parents[1] / model / artifact.name, ViewpointMatches)
                for model in models
            ]
    values = {
        method: np.stack(
            [seed.values for day in judgements.values() for seed in day.get(method, ())]
        )
        for method in methods
    }  # (sequence and seed, heading, number)
    sequence, first_day = next(iter(judgements.items()))
    first = next(iter(first_day.values()))[0]
    pictures = {
        method: (seeds[0].pictures, seeds[0].reconstructed)
        for method, seeds in first_day.items()
        if len(seeds[0].reconstructed)
    }
    curves = {
        method: [TrainingRecord.read(study.find("train", model=model)).curves for model in models]
        for method, models in methods.items()
    }
    draw = partial(illustrate, study, folder)
    return section_of(
        study,
        "viewpoints",
        {
            "correct_m": first.correct_m,
            "length": first.length,
            "step_deg": 360 / len(first.headings_deg),
        },
        illustrations=[
            draw(
                "birdview",
                _mapping(study, view, sequence),
                name="viewpoints_mapping",
                sequence=sequence,
            ),
            *(
                draw(
                    "viewpoint_curves",
                    viewpoints.precision_recall(group, day),
                    name=f"viewpoints_{day}",
                    sequence=day,
                )
                for day, group in judgements.items()
            ),
            draw(
                "viewpoint_indices",
                viewpoints.indices(
                    {
                        (method, number): stacked[:, :, i]
                        for method, stacked in values.items()
                        for i, number in enumerate(NUMBERS)
                    },
                    first.headings_deg.tolist(),
                    first.correct_m,
                ),
                name="viewpoints_indices",
            ),
            draw(
                "reconstructions",
                viewpoints.reconstructions(pictures) if pictures else None,
                name="viewpoints_reconstructions",
                sequence=sequence,
            ),
            draw("collapse", viewpoints.collapse(curves), name="viewpoints_collapse"),
        ],
        tables=[
            *tables.over_headings(study),
            *(tables.every_heading(study, number) for number in NUMBERS),
        ],
        sources=[study.folder("viewpoints", study.grid)],
    )


def _mapping(study: Study, view: BirdView, sequence: str) -> Figure:
    """How the middle submap of a sequence becomes a bird-view."""
    mapped = MappedViews(
        study.artifact(schemas.Scans, "scans", sequence),
        study.artifact(schemas.Submaps, "submaps", sequence),
        view,
    )
    points_m, octree_map, odom_T_vehicle = next(islice(mapped.maps(), len(mapped) // 2, None))
    return views.bird_view(points_m, octree_map, odom_T_vehicle, view)
