# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Motion inversion: the constant model of the paper."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.core.motion_inversion import invert_motion


@pytest.fixture
def backward_flow(generator):
    return torch.randn(100, 3, generator=generator)


def test_twice_is_identity(backward_flow):
    assert torch.equal(invert_motion(invert_motion(backward_flow)), backward_flow)


@pytest.mark.parametrize("ratio", [0.5, 2.0, 4.0])
def test_there_and_back_with_the_inverse_ratio_is_identity(backward_flow, ratio):
    there = invert_motion(backward_flow, ratio)
    assert torch.equal(invert_motion(there, 1 / ratio), backward_flow)


def test_constant_velocity():
    # 10 m/s along x: 1 m back in 0.1 s, 3 m ahead in 0.3 s.
    backward = torch.tensor([[-1.0, 0.0, 0.0]])
    torch.testing.assert_close(invert_motion(backward, 0.3 / 0.1), torch.tensor([[3.0, 0.0, 0.0]]))


def test_flow_given_is_left_alone(backward_flow):
    before = backward_flow.clone()
    invert_motion(backward_flow, 2.0)
    assert torch.equal(backward_flow, before)
