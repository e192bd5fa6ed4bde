# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rays without a hit are no points, whatever a driver writes for them; all other points are."""

import numpy as np
import pytest

from msg_utils.point_cloud2 import decode_xyz, encode_columns

BEAMS_DEG = np.arange(-15.0, 16.0, 2.0)
AZIMUTHS_DEG = np.arange(0.0, 360.0, 0.5)


def on_ground(height_m=1.8, max_range_m=np.inf):
    """Rays of 16 beams over a plane, as ranges (16, 720); infinite without a hit."""
    ranges = np.full((len(BEAMS_DEG), len(AZIMUTHS_DEG)), np.inf)
    down = BEAMS_DEG < 0
    ranges[down] = (height_m / np.sin(np.radians(-BEAMS_DEG[down])))[:, None]
    # Walls in a quarter of the directions, at all distances.
    ranges[:, :180] = np.minimum(ranges[:, :180], np.linspace(4.0, 50.0, 180))
    return np.where(ranges < max_range_m, ranges, np.inf)


def mask_of(ranges):
    """The mask of the measured points of a cloud of such rays."""
    elevation, azimuth = np.radians(BEAMS_DEG)[:, None], np.radians(AZIMUTHS_DEG)
    directions = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation) + 0 * azimuth,
        ]
    )
    columns = dict(zip("xyz", (ranges * directions).astype(np.float32).reshape(3, -1), strict=True))
    xyz, measured = decode_xyz(encode_columns(columns, *ranges.shape))
    np.testing.assert_array_equal(xyz, np.stack(list(columns.values()), 1)[measured])
    return measured.reshape(ranges.shape)


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
@pytest.mark.parametrize("range_m", [0.0, 30.0, 100.0])
def test_rays_without_a_hit_are_no_points(range_m, noise_m):
    ranges = on_ground(max_range_m=0.98 * range_m or np.inf)
    is_hit = np.isfinite(ranges)
    noise = np.random.default_rng(0).normal(0, noise_m, ranges.shape)
    ranges[~is_hit] = range_m + noise[~is_hit] if range_m else 0.0
    np.testing.assert_array_equal(mask_of(ranges), is_hit)


def test_points_at_the_largest_range_that_were_hit_are_points():
    ring = on_ground(max_range_m=40.0)
    ring[:, :180] = 3.0
    facing = np.full(ring.shape, 1.0)
    elevation, azimuth = np.radians(BEAMS_DEG)[:, None], np.radians(np.linspace(-40, 40, 180))
    facing[:, :180] = 5.0 / (np.cos(elevation) * np.cos(azimuth))
    for ranges in (np.where(np.isfinite(ring), ring, 2.0), facing):
        assert mask_of(ranges).all()
