# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Turn rates of an IMU: decoded, remembered, and those of a sweep."""

from types import SimpleNamespace

import numpy as np
import pytest

from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.sweeps.rate_track import RateTrack, are_covered
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.errors import MessageError

MS = 1_000_000
START_NS = 50_000 * MS


def imu(time_ms=0, rate=(0.1, 0.2, 0.3), covariance=0.0, frame_id="imu"):
    """With the attributes of a sensor_msgs/Imu; nobody reads the orientation."""
    sec, nanosec = divmod(START_NS + round(time_ms * MS), 10**9)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=frame_id)
    x, y, z = rate
    return SimpleNamespace(
        header=header,
        angular_velocity=SimpleNamespace(x=x, y=y, z=z),
        angular_velocity_covariance=[covariance] + 8 * [0.0],
        orientation_covariance=[-1.0] + 8 * [0.0],
    )


def track_of(*times_ms, **how):
    track = RateTrack()
    for time_ms in times_ms:
        track.add(StampedRate.of(imu(time_ms, (time_ms, 0.0, 0.0), **how)))
    return track


def sweep_at(time_ms, last_s=0.0):
    times_s = np.float32([0.0, last_s])
    return Sweep(np.zeros((2, 3), np.float32), START_NS + time_ms * MS, times_s=times_s)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (imu(rate=(0.0, np.nan, 0.0)), "invalid turn rates"),
        (imu(rate=(0.0, 1e300, 0.0)), "invalid turn rates"),
        (imu(covariance=-1.0), "no turn rates"),
        (imu(-START_NS / MS), "no stamp"),
    ],
)
def test_messages_without_rates_are_refused(message, text):
    with pytest.raises(MessageError, match=text):
        StampedRate.of(message)


def test_a_sweep_gets_the_rates_of_a_second_before_until_its_last_point():
    rates = track_of(*range(0, 2000, 10)).around(sweep_at(1500, 0.095))
    np.testing.assert_allclose(rates[[0, -1], 0], [-1.0, 0.1], atol=1e-9)
    np.testing.assert_allclose(rates[:, 1], 1500 + 1000 * rates[:, 0])
    assert are_covered(rates, 0.0, 0.095)


@pytest.mark.parametrize(
    ("times_ms", "covered"),
    [
        (range(-10, 70, 10), True),  # ends 0.04 s before the last point
        (range(-10, 50, 10), False),
        (range(10, 120, 10), False),  # begins after the first point
        ((-10, 0, 30, 81, 100), False),
        ((-40, 10, 60, 110), True),
        ((), False),
    ],
)
def test_gaps_of_a_twentieth_of_a_second_are_bridged(times_ms, covered):
    assert are_covered(track_of(*times_ms).around(sweep_at(0, 0.1)), 0.0, 0.1) is covered


def test_rates_of_another_frame_replace_all_before():
    track = track_of(0, 10, 20)
    assert not track.add(StampedRate.of(imu(10)))
    assert track.rate_hz == pytest.approx(100.0)
    assert track.add(StampedRate.of(imu(5, frame_id="other")))
    assert track.frame_id == "other"
    assert len(track.around(sweep_at(20))) == 1


def test_the_rate_is_that_of_the_last_second():
    often, seldom = range(0, 2000, 5), range(2000, 3200, 20)
    assert track_of(*often).rate_hz == pytest.approx(200.0)
    assert track_of(*often, *seldom).rate_hz == pytest.approx(50.0)
    assert track_of(0, 5000).rate_hz == pytest.approx(0.2)
    assert track_of(0).rate_hz == 0.0
