"""The section on paper 2's protocol: a sequence matched with itself from other headings.

Paper 2 is Yin et al., "Stabilize an Unsupervised Feature Learning for LiDAR-based Place
Recognition" (IROS 2018). In: a study with methods that look at
bird-views. Out: the section with its figures (Fig. 2 and 5 to 7 of that paper) and tables.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.evaluation.viewpoint_matches import NUMBERS, ViewpointMatches
from pipeline.report import tables
from pipeline.report.figures import viewpoints, views
from pipeline.report.section import Section, illustrate, section_of
from pipeline.report.study import StudyResults, TrainingRecord
from pipeline.views.birdview import BirdView
from pipeline.views.mapped import MappedViews


def section(study: StudyResults, folder: Path, view: BirdView) -> Section:
    """Draw paper 2's figures into `folder`; `view` is the bird-view that the methods look at."""
    methods = {
        family: [model.name for model in models]
        for method in study.settings.bird_view_methods
        for family, models in method.families.items()
    }
    judged = _judged(study, methods)
    sequence, first_day = next(iter(judged.items()))
    first = next(iter(first_day.values()))[0]
    # method and number to its values (sequence and seed, heading)
    values: dict[tuple[str, str], NDArray[np.float64]] = {}
    for method in methods:
        seeds = [seed for day in judged.values() for seed in day.get(method, ())]
        stacked = np.stack([seed.values for seed in seeds])
        values |= {(method, number): stacked[:, :, i] for i, number in enumerate(NUMBERS)}
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
    mapping = _mapping(study, view, sequence)
    indices = viewpoints.indices(values, first.headings_deg.tolist(), first.correct_m)
    rebuilt = viewpoints.reconstructions(pictures) if pictures else None
    return section_of(
        study,
        "viewpoints",
        {
            "correct_m": first.correct_m,
            "length": first.length,
            "step_deg": 360 / len(first.headings_deg),
        },
        illustrations=[
            draw("birdview", mapping, name="viewpoints_mapping", sequence=sequence),
            *(
                draw(
                    "viewpoint_curves",
                    viewpoints.precision_recall(group, day),
                    name=f"viewpoints_{day}",
                    sequence=day,
                )
                for day, group in judged.items()
            ),
            draw("viewpoint_indices", indices, name="viewpoints_indices"),
            draw("reconstructions", rebuilt, name="viewpoints_reconstructions", sequence=sequence),
            draw("collapse", viewpoints.collapse(curves), name="viewpoints_collapse"),
        ],
        tables=[
            *tables.over_headings(study),
            *(tables.every_heading(study, number) for number in NUMBERS),
        ],
        sources=[study.folder("viewpoints", study.grid)],
    )


def _judged(
    study: StudyResults, methods: Mapping[str, Sequence[str]]
) -> dict[str, dict[str, list[ViewpointMatches]]]:
    """Sequence to method to the matches of its models, one per seed."""
    judged: dict[str, dict[str, list[ViewpointMatches]]] = {}
    for method, models in methods.items():
        folder = study.find("viewpoints", "_", method).parent
        for path in sorted(folder.glob("*.zarr")):
            judged.setdefault(path.stem, {})[method] = [
                store.read(path.parents[1] / model / path.name, ViewpointMatches)
                for model in models
            ]
    return judged


def _mapping(study: StudyResults, view: BirdView, sequence: str) -> Figure:
    """How the middle submap of a sequence becomes a bird-view."""
    mapped = MappedViews(
        study.artifact(schemas.Scans, "scans", sequence),
        study.artifact(schemas.Submaps, "submaps", sequence),
        view,
    )
    points_m, octree_map, odom_T_vehicle = next(islice(mapped.maps(), len(mapped) // 2, None))
    return views.bird_view(points_m, octree_map, odom_T_vehicle, view)
