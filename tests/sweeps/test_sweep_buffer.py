# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The buffer gives three consecutive sweeps, whatever arrives. Defaults: gap above 0.5 s."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer

MS = 1_000_000


class Lidar:
    """Pushes sweeps of given milliseconds into a buffer."""

    def __init__(self, **settings):
        self.buffer = SweepBuffer()
        self._settings = Settings().changed(
            {f"buffer.{name}": value for name, value in settings.items()}
        )

    def send(self, *stamps_ms, frame_id="lidar"):
        """What became of each of the sweeps."""
        return [
            self.buffer.push(
                Sweep(np.zeros((1, 3), np.float32), round(stamp * MS), frame_id),
                self._settings.buffer,
            )
            for stamp in stamps_ms
        ]

    def triplet_ms(self):
        triplet = self.buffer.triplet()
        if triplet is None:
            return None
        sweeps = (triplet.previous, triplet.current, triplet.next)
        return [sweep.stamp_ns / MS for sweep in sweeps]


@pytest.fixture
def lidar():
    return Lidar()


def test_triplet_is_complete_with_the_third_sweep(lidar):
    for stamp in (0, 100):
        lidar.send(stamp)
        assert lidar.buffer.triplet() is None
    lidar.send(200)
    assert lidar.triplet_ms() == [0, 100, 200]


def test_triplet_moves_on_by_one_sweep(lidar):
    assert lidar.send(0, 100, 200, 310, 400) == [Arrival.ACCEPTED] * 5
    assert lidar.triplet_ms() == [200, 310, 400]


def test_sweeps_are_handed_on_not_copied(lidar):
    lidar.send(0, 100, 200)
    first = lidar.buffer.triplet()
    lidar.send(300)
    second = lidar.buffer.triplet()
    assert (first.current, first.next) == (second.previous, second.current)


def test_first_sweep_may_have_any_stamp(lidar):
    assert lidar.send(-5) == [Arrival.ACCEPTED]
    assert Lidar().send(2**62 / MS) == [Arrival.ACCEPTED]


@pytest.mark.parametrize("again", [200, 200.5, 199.5])
def test_duplicate_is_refused(lidar, again):
    lidar.send(0, 100, 200)
    assert lidar.send(again) == [Arrival.DUPLICATE]
    assert lidar.triplet_ms() == [0, 100, 200]


@pytest.mark.parametrize("late", [199, 150, 0, -300])
def test_late_sweep_is_refused(lidar, late):
    lidar.send(0, 100, 200)
    assert lidar.send(late) == [Arrival.OUT_OF_ORDER]
    assert lidar.triplet_ms() == [0, 100, 200]
    assert lidar.send(300) == [Arrival.ACCEPTED]


def test_time_goes_back_when_a_bag_loops(lidar):
    lidar.send(5000, 5100, 5200)
    assert lidar.send(0) == [Arrival.TIME_WENT_BACK]
    assert lidar.buffer.triplet() is None
    assert lidar.send(100, 200) == [Arrival.ACCEPTED] * 2
    assert lidar.triplet_ms() == [0, 100, 200]


def test_gap_starts_anew(lidar):
    lidar.send(0, 100, 200)
    assert lidar.send(701) == [Arrival.GAP]
    assert lidar.buffer.triplet() is None
    lidar.send(800, 900)
    assert lidar.triplet_ms() == [701, 800, 900]


def test_other_frame_starts_anew(lidar):
    lidar.send(0, 100, 200)
    assert lidar.send(300, frame_id="rear") == [Arrival.FRAME_CHANGED]
    assert lidar.buffer.triplet() is None
    lidar.send(400, 500, frame_id="rear")
    assert lidar.triplet_ms() == [300, 400, 500]


def test_other_frame_counts_before_its_stamp(lidar):
    lidar.send(100)
    assert lidar.send(100, frame_id="rear") == [Arrival.FRAME_CHANGED]


def test_limits_themselves_are_accepted():
    lidar = Lidar(min_interval_s=0.05, max_interval_s=0.2)
    assert lidar.send(0, 50, 250) == [Arrival.ACCEPTED] * 3
    assert lidar.send(299, 450.001, 250) == [Arrival.DUPLICATE, Arrival.GAP, Arrival.TIME_WENT_BACK]


def test_limits_may_change_from_sweep_to_sweep(lidar):
    lidar.send(0)
    long = Settings().changed({"buffer.max_interval_s": 5})
    late = Sweep(np.zeros((1, 3), np.float32), 3000 * MS, "lidar")
    assert lidar.buffer.push(late, long.buffer) is Arrival.ACCEPTED


def test_a_larger_buffer_has_earlier_sweeps_too():
    buffer, settings = SweepBuffer(5), Settings().buffer
    stamps_ms = (0, 100, 200, 300, 400, 500)
    for number, stamp_ms in enumerate(stamps_ms, start=1):
        buffer.push(Sweep(np.zeros((1, 3), np.float32), stamp_ms * MS), settings)
        assert len(buffer) == min(number, 5)
        assert (buffer.triplet(2) is None) == (number < 2)
        assert (buffer.triplet() is None) == (number < 3)
    triplet = buffer.triplet(5)
    before = [sweep.stamp_ns / MS for sweep in triplet.before]
    assert before == [300, 200, 100]
    assert (triplet.current.stamp_ns / MS, triplet.next.stamp_ns / MS) == (400, 500)
    buffer.clear()
    assert len(buffer) == 0
    assert buffer.triplet(2) is None


def test_two_sweeps_are_a_triplet_without_a_previous_one():
    buffer = SweepBuffer()
    for stamp_ms in (0, 100):
        buffer.push(Sweep(np.zeros((1, 3), np.float32), stamp_ms * MS), Settings().buffer)
    assert buffer.triplet(2).previous is None
    assert buffer.triplet(2).before == ()
