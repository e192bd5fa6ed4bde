# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Colors of flow, by their laws."""

import colorsys

import numpy as np

from mnsf_ros.drawing.color_wheel import SLOW, flow_colors, packed_colors, wheel_image

ANGLES = np.linspace(-np.pi, np.pi, 49)
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def hsv(colors):
    return np.array([colorsys.rgb_to_hsv(*color) for color in colors])


def test_hue_is_the_direction_and_saturation_the_speed_up_to_the_full_one():
    hues = hsv(flow_colors(DIRECTIONS, 1.0))[:, 0]
    difference = (hues - ANGLES / (2 * np.pi) + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(difference, 0.0, atol=1e-12)
    lengths = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 1e30])
    colors = flow_colors(lengths[:, None] * DIRECTIONS[7], 2.0)
    shares = (colors[:, 0] - SLOW[0]) / (colors[-1, 0] - SLOW[0])
    np.testing.assert_allclose(shares, [0, 0.25, 0.5, 0.75, 1, 1, 1], atol=1e-12)
    # Ahead is red; heights do not count.
    np.testing.assert_allclose(flow_colors(np.array([[1, 0, 9]]), 1.0), [[1, 0, 0]], atol=1e-12)


def test_no_flow_is_neutral():
    flow = np.array([[0, 0], [np.nan, 1], [1, np.inf], [np.nan, np.nan], [-np.inf, np.nan]])
    np.testing.assert_array_equal(flow_colors(flow, 1.0), [SLOW] * 5)


def test_wheel_image_shows_directions_as_the_picture_does():
    image = wheel_image(101)
    assert image.shape == (101, 101, 4)
    np.testing.assert_allclose(image[50, 50], [*SLOW, 1], atol=1e-12)
    np.testing.assert_array_equal(image[[0, 0, -1, -1], [0, -1, 0, -1], 3], 0)
    right, up = image[50, 75, :3], image[25, 50, :3]
    # As in clouds, with the root of the length.
    expected = flow_colors(np.array([[0.5**0.5, 0], [0, 0.5**0.5]]), 1.0)
    np.testing.assert_allclose([right, up], expected, atol=1e-12)


def unpacked(colors):
    return np.column_stack([colors >> 16, colors >> 8 & 0xFF, colors & 0xFF])


def test_packed_colors_are_those_of_the_wheel():
    rng = np.random.default_rng(0)
    motion = rng.normal(scale=0.5, size=(5000, 3)).astype(np.float32)
    lengths = np.hypot(motion[:, 0], motion[:, 1])
    # The root of the length, as the length of a vector of the same direction.
    vectors = motion[:, :2] * (np.sqrt(lengths / 1.5) / lengths)[:, None]
    expected = 255 * flow_colors(vectors, 1.0)
    assert np.abs(unpacked(packed_colors(motion, 1.5)) - expected).max() < 5


def test_packed_colors_of_strange_motions():
    zero, missing = [[0, 0, 9]], [[np.nan, 1, 0], [1, np.inf, 0], [-0.0, -0.0, 0]]
    motion = np.array([*zero, *missing, [1e38, 1e38, 0], [-1, -0.0, 0]], np.float32)
    none, *others = packed_colors(motion, 1.0)
    assert unpacked(np.array([none])).tolist() == [[round(255 * level) for level in SLOW]]
    assert others[:3] == [none] * 3
    far, back = unpacked(np.array(others[3:])).tolist()
    np.testing.assert_allclose(far, [255, 191, 0], atol=3)
    np.testing.assert_allclose(back, [0, 255, 255], atol=3)
    assert packed_colors(motion[:0], 1.0).shape == (0,)
