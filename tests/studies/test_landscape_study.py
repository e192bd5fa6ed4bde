# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The loss around an optimum: known bowls have known rises, and weights stay as they were."""

import numpy as np
import pytest
import torch
from torch import nn

from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.presets import preset
from mnsf_ros.studies.landscape_study import landscape, losses_along, random_direction
from mnsf_ros.studies.study import CaseStudySettings, StudyOptions


@pytest.fixture
def network():
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(3, 8), nn.ReLU(), nn.Linear(8, 3))


def bowl(network):
    """A loss whose lowest place are the network's weights: squared distance from them."""
    optimum = [item.detach().clone() for item in network.parameters()]

    def loss_of():
        pairs = zip(network.parameters(), optimum, strict=True)
        return 1.0 + sum((item - best).square().sum() for item, best in pairs)

    return loss_of


def drawn(network, seed):
    return random_direction(network, torch.Generator().manual_seed(seed))


def test_rows_of_a_direction_are_as_long_as_those_of_the_weights(network):
    for weights, part in zip(network.parameters(), drawn(network, 1), strict=True):
        if weights.ndim == 1:
            assert not part.any()
        else:
            torch.testing.assert_close(part.norm(dim=1), weights.detach().norm(dim=1))


def test_weights_are_put_back_even_after_an_error(network):
    before = [item.clone() for item in network.parameters()]

    def fails():
        raise ValueError("no loss")

    with pytest.raises(ValueError, match="no loss"):
        losses_along(network, fails, [drawn(network, 4)], [(1.0,)])
    for item, old in zip(network.parameters(), before, strict=True):
        assert torch.equal(item, old)


def test_landscape_of_a_bowl_is_lowest_in_the_middle(network, tmp_path):
    options = StudyOptions(
        tmp_path,
        EvaluationOptions(preset("paper"), seed=5),
        [],
        case=CaseStudySettings(directions=3),
    )
    found = landscape(network, bowl(network), options)
    square = found[found["kind"] == "square"]["loss_m"].to_numpy().reshape(21, 21)
    assert square.argmin() == 220
    assert square[10, 10] == pytest.approx(1.0)
    np.testing.assert_allclose(square[10], square[10, ::-1], rtol=1e-4)
    others = found[found["kind"] != "square"]
    assert others["kind"].nunique() == 3
    # A bowl rises with the square of the step.
    near, *_, far = others.groupby("first_step")["loss_m"].mean() - 1.0
    assert far == pytest.approx(100 * near, rel=1e-2)
