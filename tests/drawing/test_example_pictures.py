# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of flow from above: colours at known places, and odd inputs."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.image import imread

from mnsf_ros.drawing.color_wheel import SLOW, flow_colors
from mnsf_ros.drawing.example_pictures import MISSING, error_colors, example_picture, full_speed

CORNERS = np.array([[30.0, 30, 0], [-30, 30, 0], [30, -30, 0], [-30, -30, 0]])
VIEW_M, HEIGHT, SIDE, BOTTOM, LEFTS = 60.0, 484, 400, 26, (36, 484, 932)


def picture_of(xyz, flow, truth=None, error_m=None, motion=None):
    """The picture of a method, (H, W, 4)."""
    xyz, flow = (np.asarray(rows, np.float32) for rows in (xyz, flow))
    error_m = np.full(len(xyz), np.nan) if error_m is None else error_m
    png = example_picture("$ mnsf \\frac_{", xyz, flow, error_m, truth, motion)
    return imread(io.BytesIO(png))


def color_at(picture, x, y, panel=0):
    """RGB around a place of a panel, thin arrows aside."""
    column = LEFTS[panel] + (x + VIEW_M) / (2 * VIEW_M) * SIDE
    row = HEIGHT - BOTTOM - (y + VIEW_M) / (2 * VIEW_M) * SIDE
    patch = picture[round(row) - 3 : round(row) + 4, round(column) - 3 : round(column) + 4, :3]
    return np.median(patch.reshape(-1, 3), axis=0)


@pytest.fixture(scope="module")
def street():
    """A static ground that seems to move backward, and four squares that move; xyz, flow."""
    across = np.arange(-2, 2, 0.1)
    offsets = np.stack(np.meshgrid(across, across, [0.0]), axis=-1).reshape(-1, 3)
    squares = (CORNERS[:, None] + offsets).reshape(-1, 3)
    ground = np.random.default_rng(0).uniform(-60, 60, (40_000, 3)) * [1, 1, 0]
    ground = ground[(np.abs(np.abs(ground[:, :2]) - 30) > 3).any(axis=1)]
    directions = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0.1, -0.1, 0]])
    own = np.vstack([np.repeat(directions, len(offsets), axis=0), np.zeros_like(ground)])
    return np.vstack([squares, ground]), own - np.array([1.0, 0, 0])


def test_panels_show_flow_own_motion_and_error(street):
    xyz, flow = street
    errors = np.where(xyz[:, 1] > 0, 0.0, 1.0)
    picture = picture_of(xyz, flow, error_m=errors)
    assert picture.shape == (HEIGHT, 1384, 4)
    own = [color_at(picture, x, y, panel=1) for x, y, _ in CORNERS]
    expected = flow_colors(np.array([[1.0, 0], [0, 1], [-1, 0], [0.1, -0.1]]), 1.0, neutral=SLOW)
    np.testing.assert_allclose(own, expected, atol=0.02)
    # Left, the first square is static against the sensor.
    np.testing.assert_allclose(color_at(picture, 30, 30), SLOW, atol=0.02)
    found = [color_at(picture, 30, y, panel=2) for y in (30, -30)]
    np.testing.assert_allclose(found, error_colors(np.array([0.0, 1.0])), atol=0.02)


def test_truth_is_beside_the_estimate(street):
    xyz, flow = street
    picture = picture_of(xyz, np.full_like(flow, [-1.0, 0, 0]), flow.astype(np.float32))
    moving = flow_colors(np.array([[0.0, 1]]), 1.0, neutral=SLOW)[0]
    np.testing.assert_allclose(color_at(picture, -30, 30, panel=0), moving, atol=0.02)
    np.testing.assert_allclose(color_at(picture, -30, 30, panel=1), SLOW, atol=0.02)


def test_given_motion_and_scale_of_the_truth_are_used(street):
    xyz, flow = street
    still = picture_of(xyz, flow, motion=np.eye(4))
    np.testing.assert_allclose(color_at(still, 30, 30, panel=1), SLOW, atol=0.02)
    own = flow + np.array([1.0, 0, 0])
    truth = (flow + 3 * own).astype(np.float32)
    slow = color_at(picture_of(xyz, flow, truth), 30, 30, panel=1)
    np.testing.assert_allclose(
        slow, flow_colors(np.array([[1.0, 0]]), 4.0, neutral=SLOW)[0], atol=0.02
    )


def test_points_without_flow_are_dim(street):
    xyz, flow = street
    flow = np.where(np.arange(len(xyz))[:, None] < 6400, np.nan, flow)
    picture = picture_of(xyz, flow)
    np.testing.assert_allclose(color_at(picture, 30, 30), MISSING, atol=0.02)


NAN_ROWS = np.full((4, 3), np.nan)


@pytest.mark.parametrize(
    ("xyz", "flow"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3))),
        (NAN_ROWS, np.ones((4, 3))),
        (CORNERS, NAN_ROWS),
        (CORNERS, np.full((4, 3), 3e38)),
        (np.vstack([CORNERS * 1e37, CORNERS]), np.zeros((8, 3))),
        (np.repeat(CORNERS, 10, axis=0), np.repeat(CORNERS, 10, axis=0) * 1e30),
    ],
)
def test_odd_inputs_still_give_a_picture(xyz, flow):
    assert picture_of(xyz, flow).shape == (HEIGHT, 1384, 4)


def test_pictures_are_the_same_each_time():
    random = np.random.default_rng(3)
    xyz = random.uniform(-20, 20, (300, 3)).astype(np.float32)
    truth = np.tile(np.float32([-0.8, 0, 0]), (300, 1))
    flow = truth + np.float32(0.1)
    pictures = [example_picture("mnsf", xyz, flow, flow[:, 0], truth) for _ in range(2)]
    assert pictures[0].startswith(b"\x89PNG")
    assert pictures[0] == pictures[1]


def test_error_colors_get_lighter_up_to_the_full_error():
    colors = error_colors(np.array([0.0, 0.1, 0.2, 0.3, 5.0, np.inf, np.nan]))
    lightness = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness[:4]) > 0).all()
    np.testing.assert_array_equal(colors[4], colors[3])
    np.testing.assert_array_equal(colors[5], colors[3])
    np.testing.assert_allclose(colors[6], MISSING)


@pytest.mark.parametrize(
    ("speeds", "scale"),
    [
        ([], 0.5),
        ([0.0] * 1000 + [1.2] * 30, 1.5),
        ([2.1] * 10, 2.5),
        ([np.nan, 8.0, np.inf], 10.0),
        ([1.0] * 1000 + [400.0] * 10, 1.0),
        ([1e30], 1e30),
    ],
)
def test_scale_is_round_and_ignores_slow_and_rare_points(speeds, scale):
    flow = np.column_stack([speeds, np.zeros(len(speeds))])
    assert full_speed(np.concatenate([flow, np.zeros((3, 2))])) == pytest.approx(scale)
