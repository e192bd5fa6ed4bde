# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of several lidars that belong together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from mnsf_ros.sweeps_io.several_lidars import ArrivedSweep, LidarGroups, revolution_sweep
from msg_utils.point_cloud2 import encode_columns

SETTINGS = Settings().lidars
PERIOD_S = 0.1


class Robot:
    """Lidars that send at the times of a story; what became groups, by index and stamp."""

    def __init__(self, num_lidars=2, settings=SETTINGS):
        self._settings = settings
        self._groups = LidarGroups(num_lidars)
        self.found, self.now_s = [], 0.0

    def hear(self, *events):
        """Takes events: steady time, number of the lidar, stamp; all in seconds."""
        for now_s, index, stamp_s in sorted(events):
            sweep = Sweep(np.zeros((1, 3), np.float32), stamp_ns=round(stamp_s * 1e9))
            self._groups.add(index, ArrivedSweep(sweep, round(now_s * 1e9)), self._settings)
            self.ask(now_s)
            self.now_s = now_s
        return self.found

    def ask(self, now_s):
        for group in self._groups.due(now_s, self._settings):
            stamps = {
                index: round(item.sweep.stamp_ns / 1e9, 3) for index, item in group.sweeps.items()
            }
            self.found.append(stamps)
            self.clocks_ahead_s = group.clocks_ahead_s
        return self.found


def sweeps(index, *, start=0, stop=10, phase_s=0.0, delay_s=0.1, clock_s=0.0):
    times = [number * PERIOD_S + phase_s for number in range(start, stop)]
    return [(time + delay_s, index, time + clock_s) for time in times]


def test_sweeps_of_the_same_time_are_one_group_at_once():
    found = Robot().hear(*sweeps(0), *sweeps(1))
    assert found == [{0: t, 1: t} for t in np.round(np.arange(10) * PERIOD_S, 3)]


@pytest.mark.parametrize("phase_s", [-0.045, -0.02, 0.03, 0.04])
def test_each_sweep_of_the_first_lidar_gets_the_nearest_of_the_other(phase_s):
    found = Robot().hear(*sweeps(0, start=1), *sweeps(1, phase_s=phase_s, start=1))
    assert len(found) >= 8
    for group in found[:8]:
        assert group[1] - group[0] == pytest.approx(phase_s, abs=1e-3)


def test_lidar_that_fails_costs_one_wait_and_comes_back():
    robot = Robot()
    robot.hear(*sweeps(0, stop=3), *sweeps(1, stop=3))
    assert len(robot.found) == 3
    robot.hear((0.4, 0, 0.3))
    assert len(robot.found) == 3
    assert robot.ask(0.4 + SETTINGS.max_wait_s)[-1] == {0: 0.3}
    # From now on nobody waits for it.
    robot.hear(*sweeps(0, start=6, stop=8))
    assert robot.found[-2:] == [{0: 0.6}, {0: 0.7}]
    robot.hear(*sweeps(0, start=8, stop=11), *sweeps(1, start=8, stop=11, delay_s=0.101))
    assert robot.found[-1] == {0: 1.0, 1: 1.0}


def test_first_lidar_fails_and_comes_back():
    robot = Robot()
    robot.hear(*sweeps(0, stop=3), *sweeps(1, stop=9))
    assert [group for group in robot.found if 0 not in group][-1] == {1: 0.8}
    assert len(robot.found) >= 8
    robot.hear(*sweeps(0, start=9, stop=12), *sweeps(1, start=9, stop=12))
    assert robot.found[-1] == {0: 1.1, 1: 1.1}


@pytest.mark.parametrize("clock_s", [-1e6, -3.0, 3.0, 1e6])
def test_lidar_with_another_clock_stops_nobody(clock_s):
    robot = Robot(3)
    found = robot.hear(
        *sweeps(0, stop=20), *sweeps(1, stop=20, clock_s=clock_s), *sweeps(2, stop=20)
    )
    assert len(found) >= 17
    assert found[-1] == {0: 1.9, 2: 1.9}
    # The only one that is left goes on alone, in its own time.
    robot.hear(*sweeps(1, start=20, stop=30, clock_s=clock_s))
    assert set(robot.found[-1]) == {1}
    assert robot.found[-1][1] == pytest.approx(2.9 + clock_s, abs=1e-3)


@pytest.mark.parametrize("odd", range(3))
@pytest.mark.parametrize("clock_s", [-1.0, 3600.0])
def test_lidar_with_another_clock_that_was_alone_gives_way_to_most(odd, clock_s):
    robot = Robot(3)
    robot.hear(*sweeps(odd, stop=10, clock_s=clock_s))
    assert set(robot.found[-1]) == {odd}
    right = [index for index in range(3) if index != odd]
    alone = robot.hear(
        *sweeps(odd, start=10, stop=20, clock_s=clock_s), *sweeps(right[1], start=10, stop=20)
    )
    assert alone[-1] == {odd: pytest.approx(1.9 + clock_s)}
    found = robot.hear(
        *sweeps(odd, start=20, stop=30, clock_s=clock_s),
        *(event for index in right for event in sweeps(index, start=20, stop=30)),
    )
    assert found[-8:] == [
        dict.fromkeys(right, t) for t in np.round(np.arange(22, 30) * PERIOD_S, 3)
    ]
    assert robot.clocks_ahead_s == {odd: pytest.approx(clock_s)}


def test_phase_beyond_the_tolerance_leaves_the_other_out_of_each_group():
    settings = replace(SETTINGS, tolerance_s=0.01)
    found = Robot(settings=settings).hear(*sweeps(0), *sweeps(1, phase_s=0.04))
    assert found[:9] == [{0: t} for t in np.round(np.arange(9) * PERIOD_S, 3)]


@pytest.mark.parametrize("first", [0, 1])
def test_clocks_that_are_set_together_separate_nobody(first):
    order_s = (0.0, 0.001) if first == 0 else (0.001, 0.0)
    robot = Robot()
    for clock_s in (0.0, -50.0, 50.0):
        found = robot.hear(
            *sweeps(0, start=1, clock_s=clock_s, delay_s=order_s[0] + robot.now_s),
            *sweeps(1, start=1, clock_s=clock_s, delay_s=order_s[1] + robot.now_s),
        )
    assert [set(group) for group in found] == 27 * [{0, 1}]


def test_slow_replay_is_merged():
    found = Robot().hear(
        *(
            (20 * now_s, index, stamp_s)
            for lidar in (0, 1)
            for now_s, index, stamp_s in sweeps(lidar)
        )
    )
    assert [set(group) for group in found] == 10 * [{0, 1}]


def test_time_that_jumps_back_starts_anew():
    robot = Robot()
    robot.hear(*sweeps(0, start=100, stop=105), *sweeps(1, start=100, stop=105))
    late = [(now_s + 20, index, stamp_s) for now_s, index, stamp_s in (*sweeps(0), *sweeps(1))]
    robot.hear(*late)
    assert robot.found[-1] == {0: 0.9, 1: 0.9}
    assert [set(group) for group in robot.found] == 15 * [{0, 1}]


def test_memory_is_bounded_and_clear_forgets():
    groups = LidarGroups(2)
    for number in range(1000):
        sweep = Sweep(np.zeros((1, 3), np.float32), stamp_ns=number * 10**8)
        groups.add(0, ArrivedSweep(sweep, 0), SETTINGS)
    assert groups.is_waiting
    assert len(list(groups.due(1e9, SETTINGS))) <= 12
    groups.clear()
    assert not groups.is_waiting


@pytest.mark.parametrize("has_rings", [True, False])
def test_parts_of_a_revolution_keep_the_numbers_of_beams(has_rings):
    parts = []
    for number in range(2):
        columns = {axis: np.arange(1, 5, dtype=np.float32) for axis in "xyz"}
        if has_rings or number:
            columns["ring"] = np.uint16([0, 1, 2, 3]) + np.uint16(4 * number)
        columns["x"][1] = np.nan
        encoded = encode_columns(columns, 1, 4)
        header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=number), frame_id="lidar")
        message = SimpleNamespace(**vars(encoded), data=encoded.data, header=header)
        parts.append(CloudReader().sweep(message, Settings().time, 0))
    rings = revolution_sweep(parts).rings
    assert (rings is None) if not has_rings else (rings.tolist() == [0, 2, 3, 4, 6, 7])
