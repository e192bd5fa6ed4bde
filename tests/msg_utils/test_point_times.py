# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of points, as drivers write them, and what cannot be times."""

import numpy as np
import pytest

from mnsf_ros.settings import TimeSettings
from msg_utils.point_cloud2 import encode_columns
from msg_utils.point_times import decode_times

NUM = 500
STAMP_NS = 1_700_000_000_123_456_789
STAMP_S = STAMP_NS * 1e-9
# When the points of a sweep of 0.1 s were measured, seconds after the first, in no order.
SWEEP_S = np.random.default_rng(0).permutation(np.linspace(0.0, 0.0999, NUM))


def cloud_of(**columns):
    number = len(next(iter(columns.values())))
    xyz = {axis: np.zeros(number, np.float32) for axis in "xyz"}
    return encode_columns({**xyz, **columns}, 1, number)


def decoded(*, rule=TimeSettings(), interval_s=0.1, **columns):  # noqa: B008
    cloud = cloud_of(**columns)
    return decode_times(cloud, np.ones(cloud.width, bool), STAMP_NS, rule, interval_s)


# Driver to field name, type, and value of a point measured so many seconds after the first one.
DRIVERS = {
    "ouster-ros": ("t", np.uint32, lambda s: s * 1e9, 0.0),
    "velodyne, stamp of the first packet": ("time", np.float32, lambda s: s, 0.0),
    "velodyne, stamp of the last packet": ("time", np.float32, lambda s: s - 0.1, -0.1),
    "nebula XYZIRCAEDT": ("time_stamp", np.uint32, lambda s: s * 1e9, 0.0),
    "nebula XYZIRADT": ("time_stamp", np.float64, lambda s: s + STAMP_S, 0.0),
    "hesai": ("timestamp", np.float64, lambda s: s + STAMP_S, 0.0),
    "robosense, stamp at the end": ("timestamp", np.float64, lambda s: s + STAMP_S - 0.1, -0.1),
    "livox PointXYZRTLT": ("timestamp", np.float64, lambda s: (s + STAMP_S) * 1e9, 0.0),
    "livox offset_time": ("offset_time", np.uint32, lambda s: s * 1e9, 0.0),
    "aeva time_offset_ns": ("time_offset_ns", np.int32, lambda s: s * 1e9, 0.0),
    "converted offset_time_ns": ("offset_time_ns", np.uint32, lambda s: s * 1e9, 0.0),
    "microseconds": ("time", np.float32, lambda s: s * 1e6, 0.0),
    "int32": ("t", np.int32, lambda s: (s - 0.05) * 1e9, -0.05),
    "uint32 below 0": ("t", np.uint32, lambda s: (s - 0.03) * 1e9 % 2**32, -0.03),
}  # fmt: skip


@pytest.mark.parametrize("driver", DRIVERS)
def test_drivers_are_understood_without_settings(driver):
    name, scalar, value_of, first_s = DRIVERS[driver]
    times = decoded(**{name: value_of(SWEEP_S).astype(scalar)})
    assert times.fault == ""
    assert times.times_s.dtype == np.float32
    np.testing.assert_allclose(times.times_s, SWEEP_S + first_s, atol=2e-6)
    assert repr(name) in times.source
    assert np.dtype(scalar).name in times.source


def test_stamp_of_another_clock_is_taken_for_the_first_point():
    times = decoded(timestamp=SWEEP_S + 35.0)
    np.testing.assert_allclose(times.times_s, SWEEP_S, atol=1e-6)
    assert "another clock" in times.source


@pytest.mark.parametrize(("stamp", "first_s"), [("start", 0.0), ("end", -0.0999)])
def test_the_meaning_of_the_stamp_can_be_told(stamp, first_s):
    times = decoded(t=(SWEEP_S * 1e9).astype(np.uint32), rule=TimeSettings(stamp=stamp))
    np.testing.assert_allclose(times.times_s, SWEEP_S + first_s, atol=1e-6)


def test_field_and_unit_can_be_told():
    columns = {"t": SWEEP_S.astype(np.float32), "my_time": (SWEEP_S * 1e3).astype(np.uint16)}
    times = decoded(**columns, rule=TimeSettings(field="my_time", unit="ms"))
    np.testing.assert_allclose(times.times_s, SWEEP_S, atol=0.0011)
    assert decoded(**columns, rule=TimeSettings(field="none")).times_s is None
    missing = decoded(**columns, rule=TimeSettings(field="other"))
    assert missing.times_s is None
    assert "'other'" in missing.fault
    assert "my_time" in missing.fault


def test_the_next_field_is_tried_if_one_is_unfit():
    times = decoded(t=np.zeros(NUM, np.uint32), timestamp=SWEEP_S + STAMP_S)
    np.testing.assert_allclose(times.times_s, SWEEP_S, atol=2e-6)


@pytest.mark.parametrize("num_columns", [900, 1000, 1024, 1536, 2048])
@pytest.mark.parametrize("num_rows", [16, 32])
def test_rows_that_are_measured_one_after_the_other_have_times(num_columns, num_rows):
    """Points of a column beside each other: every 16th of them, and others, are of few rows."""
    by_row_s = 0.1 * np.arange(num_rows) / num_rows
    times = decoded(t=np.tile((1e9 * by_row_s).astype(np.uint32), num_columns))
    assert times.fault == ""
    np.testing.assert_allclose(times.times_s, np.tile(by_row_s, num_columns), atol=1e-6)


def test_times_of_few_values_were_rounded():
    times = decoded(t=np.round(SWEEP_S, 2) // 0.02 * 0.02)
    assert times.times_s is None
    assert "rounded, as by lossy compression" in times.fault


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e300, 7.0, 0.5, -1.7e9])
def test_a_few_unusable_values_cost_their_points_only(value):
    is_lost = np.arange(NUM) % 25 == 3
    times = decoded(t=np.where(is_lost, value, SWEEP_S + 0.05))
    np.testing.assert_allclose(times.times_s, np.where(is_lost, np.nan, SWEEP_S + 0.05), atol=1e-6)


def test_shares_of_the_sweep_and_milliseconds_are_told_by_the_interval():
    shares = SWEEP_S / SWEEP_S.max()
    scaled = decoded(time=shares, interval_s=0.05)
    np.testing.assert_allclose(scaled.times_s, 0.05 * shares, atol=1e-7)
    np.testing.assert_allclose(decoded(time=shares, interval_s=1.0).times_s, shares, atol=1e-6)
    in_ms = decoded(time=1e3 * SWEEP_S, interval_s=0.1)
    np.testing.assert_allclose(in_ms.times_s, SWEEP_S, atol=1e-6)


UNFIT = {
    "constant": np.zeros(NUM, np.uint32),
    "absolute time as float32": (SWEEP_S + STAMP_S).astype(np.float32),
    "NaN": np.full(NUM, np.nan),
    "one of five lost": np.where(np.arange(NUM) % 5 == 0, np.nan, SWEEP_S),
    "largest": np.finfo(np.float64).max * (-1.0) ** np.arange(NUM),
    "temperature": np.linspace(20, 35, NUM, dtype=np.float32),
    "few bits": np.arange(NUM).astype(np.uint8),
    "an hour in ns": np.linspace(0, 3.6e12, NUM),
}


@pytest.mark.parametrize("kind", UNFIT)
def test_what_cannot_be_times_is_told(kind):
    times = decoded(t=UNFIT[kind])
    assert times.times_s is None
    assert times.source == "none"
    assert "'t'" in times.fault


def test_clouds_without_such_a_field_have_no_fault():
    times = decoded(intensity=SWEEP_S.astype(np.float32))
    assert times.times_s is None
    assert times.fault == ""
    no_points = encode_columns({"t": np.zeros(0, np.uint32)}, 1, 0)
    empty = decode_times(no_points, np.zeros(0, bool), 0, TimeSettings(), 0.1)
    assert empty.times_s is None
    assert empty.fault == ""
