# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Streams of a turning lidar without times of points: they get times, once and for all."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from box_street import BoxStreet, pose

from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Start

NUM_SWEEPS = 24


@cache
def drive():
    """Sweeps at 15 m/s with times, points in the order of these."""
    street = BoxStreet()
    sweeps = [street.bent_sweep(lambda n: pose(1.5 * n - 20.0), n)[0] for n in range(NUM_SWEEPS)]
    return [sweep.part(np.argsort(sweep.times_s, kind="stable")) for sweep in sweeps]


def estimates(sweeps, **settings):
    stream = Stream(Settings().changed(settings))
    found = [stream.push(sweep) for sweep in sweeps]
    return stream, [estimate for estimate in found if estimate is not None]


def without_times():
    return [replace(sweep, times_s=None) for sweep in drive()]


def test_a_static_street_stands_once_the_times_are_known():
    stream, found = estimates(without_times())
    assert stream.rotation.is_found
    starts = [estimate.start for estimate in found]
    assert set(starts) == {Start.COLD_FIRST, Start.WARM, Start.COLD_TIMES}
    assert starts.count(Start.COLD_TIMES) == 1
    since = starts.index(Start.COLD_TIMES)
    _, untimed = estimates(without_times(), **{"time.field": "none"})
    num_moving, num_moving_untimed = (
        sum(np.count_nonzero(one.over_ground.dynamic) for one in each[since:])
        for each in (found, untimed)
    )
    assert num_moving == 0 < num_moving_untimed


@pytest.mark.parametrize(
    ("sweeps", "settings"),
    [(drive, {}), (without_times, {"time.field": "none"})],
    ids=["with times", "as the user says"],
)
def test_other_streams_are_left_as_they_are(sweeps, settings):
    stream, found = estimates(sweeps(), **settings)
    assert stream.rotation.is_found is None
    assert Start.COLD_TIMES not in {estimate.start for estimate in found}


def test_another_frame_and_a_reset_begin_anew():
    stream, _ = estimates(without_times())
    for number in range(3):
        stream.push(
            replace(without_times()[number], frame_id="rear", stamp_ns=10**12 + number * 10**8)
        )
    assert stream.rotation.is_found is None
    stream, _ = estimates(without_times())
    assert Stream(stream.settings, after=stream).rotation.is_found is None
