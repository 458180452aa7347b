"""Tests of what SCI and its ring share: the views that they refuse, and the precision of their
answers."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import torch

from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.progress import Progress
from pipeline.matching.ranking import Rows
from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier, rolled
from tests.matching.made import along

SETTINGS: dict[str, Any] = {
    **{"epochs": 4, "batch": 16, "validation_every_m": 10, "validation_length_m": 3},
    **{"threads": 1, "precision": "f32"},
}
BOTH = pytest.mark.parametrize(
    "method", [Sci(**SETTINGS), SciRing(**SETTINGS)], ids=["sci", "sci_ring"]
)
GROUND_TRUTH = np.repeat(np.arange(4), 12)


def rows() -> Rows:
    """Four scenes seen twelve times with noise, a metre apart along x."""
    rng = np.random.default_rng(0)
    images = np.repeat(rng.uniform(0, 15, (4, 8, 24)), 12, axis=0) + rng.normal(0, 0.5, (48, 8, 24))
    return along(images.astype(np.float32))


@BOTH
@pytest.mark.parametrize(
    "places",
    [np.where(np.arange(48) == 5, -1, GROUND_TRUTH), GROUND_TRUTH[1:]],
    ids=["unknown", "too few"],
)
def test_every_training_view_needs_its_place(method: Classifier, places: np.ndarray) -> None:
    with pytest.raises(InputError, match="known place"):
        method.learn(rows(), places, Progress())


@BOTH
@pytest.mark.parametrize(
    ("budget", "every_m", "epochs"), [(0.25, 10.0, 1), (0.001, 10.0, 1), (0.5, 1000.0, 2)]
)
def test_a_budget_is_a_share_of_the_epochs_a_path_may_be_too_short_for_blocks_and_images_grey(
    method: Classifier, budget: float, every_m: float, epochs: int
) -> None:
    grey = replace(method, validation_every_m=every_m, colormap="grey")
    model = grey.learn(rows(), GROUND_TRUTH, Progress(budget=budget))
    assert len(model["curves/loss"]) == epochs
    assert model["net/features.0.weight"].shape[1] == 1


@BOTH
def test_answers_are_as_precise_as_training(method: Classifier) -> None:
    """Coarse numbers move costs a little, and fine ones are not the same."""
    model = method.learn(rows(), GROUND_TRUTH, Progress())
    fine, coarse = (
        replace(method, precision=precision).localizer(model)(rows(), 4)
        for precision in ("f32", "bf16")
    )
    assert np.mean(fine.places[:, 0] == coarse.places[:, 0]) > 0.8
    difference = np.abs(np.sort(fine.costs) - np.sort(coarse.costs))
    assert 0 < difference.max() < 0.2


def test_a_model_of_another_network_is_refused_in_words() -> None:
    model = Sci(**SETTINGS).learn(rows(), GROUND_TRUTH, Progress(budget=0.1))
    with pytest.raises(ArtifactError, match="not those of a Ring: train it again"):
        SciRing(**SETTINGS).localizer(model)


@BOTH
def test_kernels_cast_once_answer_as_those_that_are_cast_each_time(
    method: Classifier, monkeypatch: pytest.MonkeyPatch
) -> None:
    coarse = replace(method, precision="bf16")
    model = coarse.learn(rows(), GROUND_TRUTH, Progress())
    once = coarse.localizer(model)(rows(), 4)
    monkeypatch.setattr(loop, "cast", lambda *_: None)
    each_time = coarse.localizer(model)(rows(), 4)
    assert all(
        np.array_equal(getattr(once, name), getattr(each_time, name), equal_nan=True)
        for name in ("costs", "novelty", "heading_deg")
    )


@dataclass(frozen=True)
class Lines(Progress):
    """Keeps what a person is shown."""

    lines: list[str] = field(default_factory=list)

    def tell(self, line: str) -> None:
        self.lines.append(line)


def test_validation_views_that_fix_no_temperature_are_reported() -> None:
    """All of them are right, so the colder the likelier."""
    method = Sci(**SETTINGS | {"epochs": 16, "dropout": 0.2})
    progress = Lines()
    model = method.learn(rows(), GROUND_TRUTH, progress)
    assert model["validation/right"].all()
    (line,) = progress.lines
    assert "validation views fix no temperature" in line


def test_each_image_is_rolled_by_its_own_columns() -> None:
    heights = torch.arange(4, dtype=torch.uint8).expand(2, 3, 4)
    turned = rolled(heights, torch.tensor([1, -1]))
    assert turned[:, 0].tolist() == [[3, 0, 1, 2], [1, 2, 3, 0]]
