"""Every artifact has a path that follows from its kind and its names."""

from pathlib import Path

import pytest

from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName

LAYOUT = Layout(Path("artifacts"))


@pytest.mark.parametrize(
    ("names", "path"),
    [
        (("scans", "campus"), "scans/campus"),
        (("scans", "campus", "day"), "scans/campus/day.zarr"),
        (("views", "campus", "birdview", "day"), "views/campus/birdview/day.zarr"),
        (("perturbed", "campus", "birdview", "turned"), "perturbed/campus/birdview/turned"),
        (("labels", "campus", "10m", "day"), "labels/campus/10m/day.zarr"),
        (("train", "campus", "10m", "sci"), "train/campus/10m/sci.zarr.zip"),
        (("evaluate", "campus", "10m", "sci"), "evaluate/campus/10m/sci"),
        (
            ("lifelong", "campus", "10m", "sci", "days-incremental"),
            "lifelong/campus/10m/sci/days-incremental.zarr",
        ),
        (("events", "campus", "day"), "events/campus/day.csv"),
        (("latency", "campus", "10m"), "latency/campus/10m.csv"),
        (("results", "campus", "results.csv"), "results/campus/results.csv"),
        (("report",), "report"),
    ],
)
def test_an_artifact_lies_below_its_kind_and_data_set(names: tuple[str, ...], path: str) -> None:
    assert LAYOUT.path(*names) == Path("artifacts", path)


def test_answers_lie_with_the_stage_that_gave_them() -> None:
    model = ModelName("sci", "4way", 1)
    posed = ModelName("sci", "4way", 1, posed=True)
    followed = ModelName("sci", "4way", 1, posed=True, path="filter")
    names = (model, posed, followed)
    paths = [LAYOUT.answers("campus", "10m", name, "day") for name in names]
    assert [path.relative_to("artifacts").as_posix() for path in paths] == [
        "localize/campus/10m/sci-4way-seed1/day.zarr",
        "poses/campus/10m/sci-4way-seed1/day.zarr",
        "paths/campus/10m/sci-4way-pose-filter-seed1/day.zarr",
    ]
