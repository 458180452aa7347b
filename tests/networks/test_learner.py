"""Tests of a network that learns further places: which views are replayed, and the rows of new
places."""

import numpy as np
import pytest
import torch
from torch import nn

from pipeline.networks.learner import hardest, widened


class Last(nn.Module):
    """A network of its last layer alone."""

    last_layer = "fc2"

    def __init__(self) -> None:
        super().__init__()
        self.fc2 = nn.Linear(2, 2)
        self.fc2.load_state_dict(
            {"weight": torch.tensor([[2.0, 0.0], [0.0, 4.0]]), "bias": torch.tensor([1.0, 3.0])}
        )


def test_of_each_place_the_views_of_the_highest_loss_are_replayed() -> None:
    # Rows 0 to 2 are of place 0, row 3 of place 1; the loss rises as the margin of the true place
    # falls: rows 1, 0, 2.
    logits = torch.tensor([[1.0, 0.0], [0.0, 1.0], [5.0, 0.0], [0.0, 9.0]])
    places = np.array([0, 0, 0, 1])
    assert hardest(logits, places, 1).tolist() == [1, 3]
    assert hardest(logits, places, 2).tolist() == [0, 1, 3]
    assert hardest(logits, places, 0).tolist() == []


def test_a_new_place_begins_as_its_mean_feature_as_long_as_the_known_rows() -> None:
    # Known rows are 2 and 4 long, so 3 on average; the biases are 2 on average. The new place's two
    # features point to (1, 1).
    features = torch.tensor([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    weights = widened(Last(), features, np.array([2, 2, 0]))
    assert weights["fc2.weight"][:2].tolist() == [[2, 0], [0, 4]]
    assert weights["fc2.weight"][2].tolist() == pytest.approx([3 / 2**0.5] * 2)
    assert weights["fc2.bias"].tolist() == [1, 3, 2]


def test_without_a_new_place_the_weights_stay() -> None:
    before = Last()
    same = widened(before, torch.tensor([[1.0, 0.0]]), np.array([1]))
    assert all(torch.equal(same[name], value) for name, value in before.state_dict().items())
