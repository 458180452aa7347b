"""Settings of trainings that are small enough for tests."""

from collections.abc import Iterator
from functools import partial

import pytest

from pipeline.methods.pfl import features
from pipeline.methods.pointnetvlad import pointnetvlad


@pytest.fixture(scope="module", autouse=True)
def small_training() -> Iterator[None]:
    """PFL in rounds of 2 iterations; PointNetVLAD's network with 32 numbers of 8 clusters of 64
    features, 300 thousand weights to write to a checkpoint instead of 20 million."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(features, "LEAST_ITERATIONS", 2)
        patch.setattr(pointnetvlad, "Describer", partial(pointnetvlad.Describer, 64, 8, 32))
        yield
