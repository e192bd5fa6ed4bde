# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses in messages <-> matrices, with one tolerance for live and recorded ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from box_street import pose

from mnsf_ros.geometry.transforms import pose_matrix, pose_quaternion
from msg_utils.errors import MessageError


def message(position=(1.0, 2.0, 3.0), quaternion=(0.0, 0.0, 0.0, 1.0)):
    return SimpleNamespace(
        position=SimpleNamespace(**dict(zip("xyz", position, strict=True))),
        orientation=SimpleNamespace(**dict(zip("xyzw", quaternion, strict=True))),
    )


@pytest.mark.parametrize("length", [0.51, 0.998, 1.0, 1.002, 1.49])
def test_rounded_quaternion_is_normalised(length):
    expected = pose(1, 2, 3, yaw_deg=200, pitch_deg=10)
    quaternion = length * np.array(pose_quaternion(expected))
    assert quaternion[3] >= 0
    np.testing.assert_allclose(pose_matrix(message(quaternion=quaternion)), expected, atol=1e-12)


@pytest.mark.parametrize("length", [0.0, 0.49, 1.51, 1e300, np.nan, np.inf])
def test_quaternion_of_another_length_is_refused_with_its_norm(length):
    with pytest.raises(MessageError, match=r"quaternion .* \(norm .*, expected 1\)"):
        pose_matrix(message(quaternion=(0, 0, 0, length)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e9, -1e9])
def test_position_beyond_all_distances_is_refused(value):
    with pytest.raises(MessageError, match=r"position .* 1e"):
        pose_matrix(message(position=(0, value, 0)))
