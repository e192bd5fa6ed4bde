# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of flow from above: their size, the colors at known places, and odd inputs."""

from __future__ import annotations

import re

import numpy as np
import pytest
from matplotlib.image import imread

from mnsf_ros.drawing.color_wheel import SLOW, flow_colors
from mnsf_ros.drawing.flow_panel import MISSING, full_speed
from mnsf_ros.drawing.top_view import save_top_view
from mnsf_ros.errors import MnsfError

PANEL_LEFT, PANEL_BOTTOM, PANEL_SIDE = 62, 62, 642
VIEW_M = 50.0
CORNERS = np.array([[30.0, 30, 0], [-30, 30, 0], [30, -30, 0], [-30, -30, 0]])


def dense_squares(centers, half_m=1.5):
    """Points that cover a square around each center without gaps, (C, P, 3)."""
    across = np.arange(-half_m, half_m, 0.1)
    offsets = np.stack(np.meshgrid(across, across, [0.0]), axis=-1).reshape(-1, 3)
    return centers[:, None] + offsets


def color_at(picture, x, y, *, panel=0, row=0):
    """RGB in the picture around a place of a panel, thin arrows aside; row 0 is the top one."""
    column = PANEL_LEFT + 800 * panel + (x + VIEW_M) / (2 * VIEW_M) * PANEL_SIDE
    up = PANEL_BOTTOM + (y + VIEW_M) / (2 * VIEW_M) * PANEL_SIDE
    down = 800 * (row + 1) - up
    patch = picture[round(down) - 4 : round(down) + 5, round(column) - 4 : round(column) + 5, :3]
    return np.median(patch.reshape(-1, 3), axis=0)


def draw(tmp_path, xyz, flow, **options):
    path = tmp_path / "picture.png"
    save_top_view(path, np.asarray(xyz), np.asarray(flow), title="title", **options)
    return imread(path)


@pytest.fixture(scope="module")
def street():
    """A static ground that seems to move backward, and four squares that move; xyz, flow, own."""
    ground = np.random.default_rng(0).uniform(-60, 60, (40_000, 3)) * [1, 1, 0]
    ground = ground[(np.abs(np.abs(ground[:, :2]) - 30) > 2).any(axis=1)]
    squares = dense_squares(CORNERS)
    directions = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0.1, -0.1, 0]])
    own = np.broadcast_to(directions[:, None], squares.shape).reshape(-1, 3)
    xyz = np.vstack([squares.reshape(-1, 3), ground])
    own = np.vstack([own, np.zeros_like(ground)])
    return xyz, own - np.array([1.0, 0, 0]), own


def test_size_and_colors(tmp_path, street):
    xyz, flow, _ = street
    picture = draw(tmp_path, xyz, flow)
    assert picture.shape == (800, 1600, 4)
    right = [color_at(picture, x, y, panel=1) for x, y, _ in CORNERS]
    residuals = np.array([[1.0, 0], [0, 1], [-1, 0], [0.1, -0.1]])
    expected = flow_colors(residuals, 1.0, neutral=SLOW)
    np.testing.assert_allclose(right, expected, atol=0.02)
    # Left, the first square stands still against the sensor, and the third goes twice as fast.
    np.testing.assert_allclose(color_at(picture, 30, 30), SLOW, atol=0.02)
    third = color_at(picture, 30, -30)
    assert third[0] < 0.2 < third[1]


def test_given_motion_is_used(tmp_path, street):
    xyz, flow, _ = street
    picture = draw(tmp_path, xyz, flow, next_from_current=np.eye(4))
    np.testing.assert_allclose(color_at(picture, 30, 30, panel=1), SLOW, atol=0.02)


def test_truth_is_a_second_row_in_the_same_colors(tmp_path, street):
    xyz, flow, own = street
    picture = draw(tmp_path, xyz, flow, truth=flow + 2 * own)
    assert picture.shape == (1600, 1600, 4)
    colors = [color_at(picture, 30, 30, panel=1, row=row) for row in (0, 1)]
    expected = flow_colors(np.array([[1.0, 0], [3.0, 0]]), 3.0, neutral=SLOW)
    np.testing.assert_allclose(colors, expected, atol=0.02)


def test_points_without_flow_are_dim(tmp_path):
    xyz = dense_squares(CORNERS[:1])[0]
    picture = draw(tmp_path, xyz, np.full_like(xyz, np.nan))
    for panel in (0, 1):
        np.testing.assert_allclose(color_at(picture, 30, 30, panel=panel), MISSING, atol=0.02)


def test_fast_points_lie_on_top(tmp_path):
    xyz = dense_squares(CORNERS[:1])[0]
    for fast_first in (True, False):
        flows = [np.full_like(xyz, 0.0), np.broadcast_to([0.5, 0, 0], xyz.shape)]
        flows = flows[::-1] if fast_first else flows
        picture = draw(
            tmp_path, np.vstack([xyz, xyz]), np.vstack(flows), next_from_current=np.eye(4)
        )
        assert color_at(picture, 30, 30)[0] > 0.95


@pytest.mark.parametrize(
    ("xyz", "flow"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3))),
        (np.zeros((1, 3)), np.ones((1, 3))),
        (np.full((5, 3), np.nan), np.ones((5, 3))),
        (CORNERS, np.full((4, 3), np.nan)),
        (np.full((4, 3), np.inf), CORNERS),
        (CORNERS * 1e20, np.ones((4, 3))),
        (CORNERS.astype(np.float32), np.full((4, 3), 3e38, np.float32)),
        (np.vstack([CORNERS * 1e37, CORNERS]).astype(np.float32), np.zeros((8, 3), np.float32)),
        (CORNERS, np.full((4, 3), -np.inf)),
        (np.repeat(CORNERS, 10, axis=0), np.repeat(CORNERS, 10, axis=0) * 1e30),
    ],
)
def test_odd_inputs_still_give_a_picture(tmp_path, xyz, flow):
    assert draw(tmp_path, xyz, flow).shape == (800, 1600, 4)


def test_nothing_in_view_says_so(tmp_path):
    nothing = draw(tmp_path, np.zeros((0, 3)), np.zeros((0, 3)))
    far = draw(tmp_path, CORNERS + 100, CORNERS * 0)
    panel = np.s_[110:730, 70:700]
    assert nothing[panel][..., :3].max() > 0.5
    np.testing.assert_array_equal(nothing[panel], far[panel])


def test_a_million_points(tmp_path):
    xyz = np.random.default_rng(0).uniform(-60, 60, (1_000_000, 3)).astype(np.float32)
    assert draw(tmp_path, xyz, np.full_like(xyz, 0.3)).shape == (800, 1600, 4)


def test_title_is_no_formula_and_the_folder_is_made(tmp_path):
    path = tmp_path / "new" / "folder" / "picture.png"
    save_top_view(str(path), CORNERS, CORNERS * 0, title="100 $ and 200 $ \\frac_{")
    assert path.read_bytes().startswith(b"\x89PNG\r\n")


def test_inputs_are_not_changed(tmp_path):
    xyz, flow = CORNERS.copy(), CORNERS * 0.01
    xyz.flags.writeable = flow.flags.writeable = False
    draw(tmp_path, xyz, flow, truth=flow)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"flow": CORNERS[:2]}, "flow: got shape (2, 3), expected that of xyz, (4, 3)"),
        ({"xyz": CORNERS[:, :2]}, "xyz: got shape (4, 2), expected (N, 3)"),
        ({"truth": CORNERS[:3]}, "flow: got shape (3, 3), expected that of xyz, (4, 3)"),
        ({"next_from_current": np.eye(2)}, "next_from_current is [[1.0, 0.0], [0.0, 1.0]], "),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, options, text):
    with pytest.raises(MnsfError, match=f"^{re.escape(text)}"):
        draw(tmp_path, **({"xyz": CORNERS, "flow": CORNERS} | options))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("speeds", "scale"),
    [
        ([], 0.5),
        ([0.05] * 99 + [0.2], 0.5),
        ([0.0] * 1000 + [1.2] * 30, 1.5),
        ([2.0] * 10, 2.0),
        ([2.1] * 10, 2.5),
        ([np.nan, 8.0, np.inf], 10.0),
        ([1.0] * 1000 + [400.0] * 10, 1.0),
        ([1e30], 1e30),
    ],
)
def test_scale_is_round_and_ignores_what_is_slow_or_rare(speeds, scale):
    flow = np.column_stack([speeds, np.zeros(len(speeds))])
    assert full_speed([flow, np.zeros((3, 2))]) == pytest.approx(scale)
