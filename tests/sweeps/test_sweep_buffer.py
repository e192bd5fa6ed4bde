# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The buffer gives three consecutive sweeps, whatever arrives. Defaults: gap above 0.5 s."""

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer

MS = 1_000_000


class Lidar:
    """Pushes sweeps of given milliseconds into a buffer."""

    def __init__(self, *numbers, **settings):
        self.buffer = SweepBuffer(*numbers)
        self.triplet = None
        self._settings = Settings().changed(
            {f"buffer.{name}": value for name, value in settings.items()}
        )

    def send(self, *stamps_ms, frame_id="lidar"):
        """The arrival of each of the sweeps."""
        arrivals = []
        for stamp in stamps_ms:
            sweep = Sweep(np.zeros((1, 3), np.float32), round(stamp * MS), frame_id)
            arrival, self.triplet = self.buffer.push(sweep, self._settings.buffer)
            arrivals.append(arrival)
        return arrivals

    def triplet_ms(self):
        return self.triplet and [sweep.stamp_ns / MS for sweep in self.triplet.sweeps]


@pytest.fixture
def lidar():
    return Lidar()


def test_triplet_is_complete_with_the_third_sweep(lidar):
    for stamp in (0, 100):
        lidar.send(stamp)
        assert lidar.triplet is None
    lidar.send(200)
    assert lidar.triplet_ms() == [0, 100, 200]


@pytest.mark.parametrize("again", [200, 200.5, 199.5, 199, 150, 0, -300])
def test_duplicate_and_late_sweep_are_refused_and_the_triplet_moves_on(lidar, again):
    lidar.send(0, 100, 200)
    expected = Arrival.DUPLICATE if again > 199 else Arrival.OUT_OF_ORDER
    assert lidar.send(again) == [expected]
    assert lidar.triplet is None
    assert lidar.send(300) == [Arrival.ACCEPTED]
    assert lidar.triplet_ms() == [100, 200, 300]


@pytest.mark.parametrize(
    ("first_ms", "frame_id", "arrival"),
    [
        (-4800, "lidar", Arrival.TIME_WENT_BACK),
        (701, "lidar", Arrival.GAP),
        (300, "rear", Arrival.FRAME_CHANGED),
        (200, "rear", Arrival.FRAME_CHANGED),
    ],
)
def test_break_starts_anew(lidar, first_ms, frame_id, arrival):
    lidar.send(0, 100, 200)
    assert lidar.send(first_ms, frame_id=frame_id) == [arrival]
    assert lidar.triplet is None
    assert lidar.send(first_ms + 100, first_ms + 200, frame_id=frame_id) == [Arrival.ACCEPTED] * 2
    assert lidar.triplet_ms() == [first_ms, first_ms + 100, first_ms + 200]


def test_limits_themselves_are_accepted():
    lidar = Lidar(min_interval_s=0.05, max_interval_s=0.2)
    assert lidar.send(0, 50, 250) == [Arrival.ACCEPTED] * 3
    assert lidar.send(299, 450.001, 250) == [Arrival.DUPLICATE, Arrival.GAP, Arrival.TIME_WENT_BACK]


def test_a_larger_buffer_has_earlier_sweeps_too():
    lidar = Lidar(5)
    lidar.send(0, 100, 200)
    assert lidar.triplet_ms() == [0, 100, 200]
    lidar.send(300, 400, 500)
    assert lidar.triplet_ms() == [100, 200, 300, 400, 500]
    assert lidar.triplet.current.stamp_ns == 400 * MS
    lidar.buffer.clear()
    assert len(lidar.buffer) == 0
    lidar.send(600, 700)
    assert lidar.triplet is None


def test_two_sweeps_are_a_triplet_where_they_are_enough():
    lidar = Lidar(3, 2)
    lidar.send(0)
    assert lidar.triplet is None
    lidar.send(100)
    assert lidar.triplet.before == ()
    lidar.send(200)
    assert lidar.triplet_ms() == [0, 100, 200]
