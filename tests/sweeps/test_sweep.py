# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps and triplets: arrays are checked once, and the intervals are right."""

import re

import numpy as np
import pytest

from mnsf_ros.errors import SweepError
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

POINTS = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9], [-1, -2, -3]])


def read_only(array):
    array = np.array(array)
    array.setflags(write=False)
    return array


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(POINTS.astype(np.float64), id="float64"),
        pytest.param(POINTS.astype(">f4"), id="big-endian"),
        pytest.param(POINTS.tolist(), id="list"),
        pytest.param(np.asfortranarray(POINTS, dtype=np.float32), id="column-major"),
        pytest.param(np.repeat(POINTS, 2, axis=0)[::2].astype(np.float32), id="not contiguous"),
        pytest.param(read_only(POINTS.astype(np.float32)), id="read-only"),
        pytest.param(np.hstack([POINTS, np.full((4, 2), np.nan)]), id="wider, rest NaN"),
    ],
)
def test_array_becomes_float32_rows_in_order(points):
    sweep = Sweep.from_array(points, stamp_ns=2**62 + 1, frame_id="lidar")
    assert sweep.xyz.dtype == np.float32
    np.testing.assert_array_equal(sweep.xyz, POINTS)
    # Compiled loops take no others.
    assert sweep.xyz.flags.c_contiguous
    assert sweep.xyz.flags.writeable
    assert repr(sweep) == f"Sweep(points=4, stamp_ns={2**62 + 1}, frame_id='lidar')"


@pytest.mark.parametrize(
    ("points", "got"),
    [
        (np.zeros(3), "shape (3,) of float64"),
        (None, "shape () of object"),
        (np.zeros((2, 4, 3)), "shape (2, 4, 3) of float64"),
        (np.zeros((4, 3), bool), "shape (4, 3) of bool"),
        (np.zeros((4, 3), complex), "shape (4, 3) of complex128"),
        ([["1", "2", "3"]], "shape (1, 3) of <U1"),
        (np.zeros(4, [("x", "f4"), ("y", "f4")]), "shape (4,) of [('x', '<f4'), ('y', '<f4')]"),
        ([[1, 2, 3], [1, 2]], "rows of different lengths"),
    ],
)
def test_not_an_array_of_points(points, got):
    text = f"next: got {got}, expected (N, 3) numbers"
    with pytest.raises(SweepError, match=f"^{re.escape(text)}$"):
        Sweep.from_array(points, name="next")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_points_that_are_not_finite_are_counted(bad):
    points = np.array([[0, 0, bad], [bad, bad, bad], [1, 2, 3]])
    with pytest.raises(SweepError, match=r"^points: 2 of 3 points are not finite; remove them$"):
        Sweep.from_array(points)


def triplet(*stamps_ns):
    sweeps = [
        None if stamp is None else Sweep.from_array(POINTS, stamp_ns=stamp) for stamp in stamps_ns
    ]
    return SweepTriplet(*sweeps)


def test_interval():
    assert triplet(0, 100_000_000, 300_000_000).interval_s == 0.2
    # Nanoseconds of today are no float64: only their difference is.
    assert triplet(None, 1_760_000_000_000_000_001, 1_760_000_000_000_000_002).interval_s == 1e-9


@pytest.mark.parametrize(
    ("stamps_ns", "ratio"),
    [
        ((0, 100, 200), 1),
        ((0, 100, 300), 2),
        ((0, 200, 300), 0.5),
        ((None, 100, 300), 1),  # two sweeps: nothing to compare with
        ((0, 0, 0), 1),  # no stamps
        # Nonsense is not made worse by a negative ratio.
        ((300, 200, 100), 1),
        ((0, 100, 50), 1),
        ((100, 50, 200), 1),
    ],
)
def test_interval_ratio(stamps_ns, ratio):
    assert triplet(*stamps_ns).interval_ratio == ratio


@pytest.mark.parametrize("rows", [np.array([2, 0]), np.array([True, False, True, False])])
def test_part_has_the_columns_of_its_points(rows):
    sweep = Sweep(
        POINTS.astype(np.float32),
        kept=np.array([True, True, False, False]),
        times_s=read_only(np.arange(4, dtype=np.float32)),
    )
    part = sweep.part(rows)
    np.testing.assert_array_equal(part.xyz, sweep.xyz[rows])
    np.testing.assert_array_equal(part.kept, sweep.kept[rows])
    np.testing.assert_array_equal(part.times_s, sweep.times_s[rows])
    assert part.times_s.flags.writeable
    assert Sweep(sweep.xyz).part(rows).times_s is None


def test_middle_of_the_times():
    xyz = POINTS.astype(np.float32)
    times_s = np.array([0.1, -0.2, 0.0, 0.05], np.float32)
    assert Sweep(xyz, times_s=times_s).middle_s == pytest.approx(-0.05)
    assert Sweep(xyz).middle_s == Sweep(xyz[:0], times_s=times_s[:0]).middle_s == 0


def test_a_fingerprint_tells_clouds_apart_and_not_stamps():
    xyz = np.random.default_rng(0).normal(0, 10, (100_000, 3)).astype(np.float32)
    prints = [Sweep(xyz, 1).fingerprint, Sweep(xyz.copy(), 2).fingerprint]
    assert prints[0] == prints[1]
    # Noise of a few micrometres, one point less, a cloud of no point.
    others = [xyz + np.float32(1e-5), xyz[:-1], xyz[:0]]
    assert len({prints[0], *(Sweep(other).fingerprint for other in others)}) == 4
