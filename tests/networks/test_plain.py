"""Tests that the networks in plain NumPy answer as those in torch do."""

from typing import Any

import numpy as np
import pytest
import torch

from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.plain import Plain

LOOKS: dict[str, Any] = {"colormap": "jet", "h_min_m": 0.5, "h_max_m": 12.0}


@pytest.mark.parametrize("method", [Sci, SciRing])
@pytest.mark.parametrize("shape", [(40, 120), (20, 64)])
def test_scores_features_and_headings_are_torchs(
    method: type[Classifier], shape: tuple[int, int]
) -> None:
    torch.manual_seed(0)
    trained = method(precision="f32", threads=1, **LOOKS)
    net = trained.network(30, *shape)
    for module in net.modules():  # as after training: norms that do something
        if isinstance(module, torch.nn.BatchNorm2d):
            for values in (module.weight, module.bias, module.running_mean, module.running_var):
                torch.nn.init.uniform_(values, 0.2, 1.0)
    heights_m = np.random.default_rng(0).uniform(-1, 15, (5, *shape)).astype(np.float32)
    with torch.no_grad():
        prediction = trained.predict(net, trained.heights(heights_m))
    plain = Plain.of(loop.arrays(net), **LOOKS)
    answers = [plain(image) for image in heights_m]
    # headings are angles in degrees, of a sum of unit vectors that may be short
    for ours, torchs, atol in zip(
        zip(*answers, strict=True), prediction, (1e-5, 1e-5, 0.05), strict=True
    ):
        np.testing.assert_allclose(np.array(ours), torchs.numpy(), atol=atol, rtol=1e-5)


def test_a_network_of_another_kind_is_none_of_these() -> None:
    assert not Plain.is_in({"net/features.0.weight": np.zeros(1, np.float32)})
