"""The networks on a GPU, where there is one: the same training, and answers as a processor gives
them."""

from typing import Any

import numpy as np
import pytest
import torch

from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks import classifier
from pipeline.networks.classifier import Classifier
from pipeline.running.progress import Progress
from tests.networks.test_classifier import SETTINGS, TRUTH, rows

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here"),
]
LONGER: dict[str, Any] = SETTINGS | {"epochs": 16, "dropout": 0.2, "precision": "auto"}


@pytest.mark.parametrize("method", [Sci(**LONGER), SciRing(**LONGER)], ids=["sci", "sci_ring"])
def test_a_gpu_trains_a_model_that_a_processor_answers_with(
    method: Classifier, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.cuda.reset_peak_memory_stats()
    model = method.learn(rows(), TRUTH, Progress())
    assert torch.cuda.max_memory_allocated() > 0  # it was used
    there = method.localizer(model)(rows(), 4)
    monkeypatch.setattr(classifier, "device", lambda: torch.device("cpu"))
    here = method.localizer(model)(rows(), 4)
    assert (there.places[:, 0] == TRUTH).mean() > 0.9
    np.testing.assert_array_equal(there.places[:, 0], here.places[:, 0])
    np.testing.assert_allclose(
        there.costs, here.costs, atol=0.05
    )  # bfloat16 on the one, perhaps not on the other
