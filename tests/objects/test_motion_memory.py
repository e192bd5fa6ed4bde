"""What one triplet hands to the next."""

from __future__ import annotations

import re

import numpy as np
import pytest
from box_street import BoxStreet, pose, stamp_ns, unrelated_sweep
from small_scenes import rows

from mnsf_ros.core.flow_estimate import Start
from mnsf_ros.errors import SweepError
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.motion_memory import MotionMemory
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

STREET = BoxStreet()
SETTINGS = Settings()


def sweep(index, **how):
    return STREET.sweep(pose(0.5 * index, yaw_deg=2 * index), index, points_per_box=100, **how)


def memory_after(*indices, settings=SETTINGS):
    """A memory that has seen these sweeps, and the last one made ready."""
    memory = MotionMemory(settings)
    prepared = [memory.prepared(sweep(index))[0] for index in indices]
    return memory, prepared[-1]


def object_at(*centers):
    """Objects with one point each, in the frame of the current sweep."""
    number = len(centers)
    owners = np.arange(number)
    return ObjectPoints(owners + 1, rows(*centers), owners, np.zeros(number, np.float32))


def followed(memory, current, objects, motions, interval_s):
    """The tracks, and the track of each object, after objects were seen to move."""
    none = np.zeros(len(objects))
    moving = JudgedMotions(motions, none[:, None], none[:, None][:, :0], none)
    are_clear = np.ones(len(objects), dtype=bool)
    return memory.follow(current, objects, moving, none, are_clear, interval_s)


class TestPast:
    @pytest.mark.parametrize(
        ("indices", "expected"),
        [
            ((0, 1, 2, 3, 4, 5, 6, 7), [3, 6]),
            ((0, 1, 2, 3, 4, 5), [3, 5]),
            ((0, 2, 5), [3, 5]),
            ((1, 5), [4]),
            ((0, 5), [5]),
            ((2, 5), [3]),
            ((4, 5), []),
            ((0, 8), []),
            ((5,), []),
        ],
    )
    def test_is_the_sweeps_nearest_to_three_and_six_tenths_of_a_second_ago(self, indices, expected):
        memory, current = memory_after(*indices)
        found = memory.past(current, interval_s=0.1)
        ages = [(current.sweep.stamp_ns - item.sweep.sweep.stamp_ns) / 1e8 for item in found]
        assert ages == expected
        assert [-item.steps for item in found] == pytest.approx(expected)

    def test_is_not_the_previous_sweep_itself(self):
        """At three sweeps a second that of a third of a second ago is the previous one."""
        memory, current = memory_after(0, 3, 6)
        (found,) = memory.past(current, interval_s=0.3)
        assert found.sweep.sweep.stamp_ns == stamp_ns(0)

    def test_steps_are_intervals_of_the_flow(self):
        memory, current = memory_after(0, 1, 2, 3)
        (found,) = memory.past(current, interval_s=0.15)
        assert found.steps == pytest.approx(-2)

    def test_is_unknown_without_stamps(self):
        memory, current = memory_after(0, 1, 2, 3)
        assert memory.past(current, interval_s=0.0) == []

    def test_reaches_no_farther_than_where_registration_failed(self):
        """Where the sensor was before that, beside where it is now, nobody knows."""
        memory = MotionMemory(SETTINGS)
        memory.prepared(*(sweep(index) for index in (0, 1, 2)))
        memory.prepared(unrelated_sweep(3))
        for index, expected in ((4, []), (5, []), (6, [4]), (7, [4])):
            (current,) = memory.prepared(sweep(index))
            found = memory.past(current, interval_s=0.1)
            assert [item.sweep.sweep.stamp_ns for item in found] == list(map(stamp_ns, expected))

    def test_reaches_no_farther_than_the_world(self):
        memory = MotionMemory(SETTINGS)
        for index in (0, 1, 2):
            memory.prepared(sweep(index))
        (current,) = memory.prepared(sweep(3, frame_id="other"))
        assert memory.past(current, 0.1) == []


class TestPrepared:
    def test_each_sweep_once(self):
        memory = MotionMemory(SETTINGS)
        sweeps = [sweep(index) for index in range(4)]
        first = memory.prepared(*sweeps[:3])
        assert memory.prepared(*sweeps[1:])[:2] == first[1:]

    def test_only_the_last_ones_are_kept(self):
        memory = MotionMemory(SETTINGS)
        sweeps = [sweep(index) for index in range(15)]
        first = memory.prepared(sweeps[0])[0]
        for each in sweeps[1:]:
            memory.prepared(each)
        assert len(memory._sweeps) == 12
        assert first.sweep not in memory._sweeps

    def test_memory_is_bounded_where_every_triplet_is_refused(self):
        memory = MotionMemory(SETTINGS)
        sweeps = [sweep(index) for index in range(36)]
        sweeps = [
            Sweep(each.xyz[:5], each.stamp_ns, each.frame_id) if index % 3 == 2 else each
            for index, each in enumerate(sweeps)
        ]
        for first in range(len(sweeps) - 2):
            with pytest.raises(SweepError, match="points are left"):
                memory.prepared(*sweeps[first : first + 3])
        assert len(memory._sweeps) <= 12

    @pytest.mark.parametrize(
        "odd", [{"index": 30}, {"index": 0.5}, {"index": 2, "frame_id": "other"}]
    )
    def test_sweeps_of_two_worlds_are_refused(self, odd):
        memory = MotionMemory(SETTINGS)
        text = f"sweep {stamp_ns(1)}: the sweeps of its triplet do not follow each other"
        with pytest.raises(SweepError, match=f"^{re.escape(text)}"):
            memory.prepared(sweep(0), sweep(1), sweep(**odd))
        following = [sweep(index) for index in (40, 41, 42)]
        assert len(memory.prepared(*following)) == 3


class TestStart:
    def start_after(self, triplet_index, frame_id="lidar", *, settings=SETTINGS, interval_s=0.1):
        """The start of a triplet after objects were seen to move at sweep 5."""
        memory, current = memory_after(5, settings=settings)
        followed(memory, current, object_at((5, 0, 0)), rows((1, 0, 0)), interval_s)
        sweeps = (sweep(triplet_index + step, frame_id=frame_id) for step in (-1, 0, 1))
        return memory.start(SweepTriplet(*sweeps))

    def test_first(self):
        triplet = SweepTriplet(sweep(0), sweep(1), sweep(2))
        assert MotionMemory(SETTINGS).start(triplet) is Start.COLD_FIRST

    def test_reasons(self):
        gap = round(10 * SETTINGS.warm_start.max_gap_s)
        assert self.start_after(6) is Start.WARM
        assert self.start_after(5 + gap) is Start.WARM
        assert self.start_after(6 + gap) is Start.COLD_GAP
        assert self.start_after(4) is Start.COLD_TIME_JUMP
        assert self.start_after(6, frame_id="other") is Start.COLD_FRAME
        assert self.start_after(6, interval_s=0.0) is Start.COLD_FIRST

    def test_off(self):
        off = SETTINGS.changed({"warm_start.enabled": False})
        assert self.start_after(6, settings=off) is Start.COLD_BY_SETTING


class TestExpected:
    def expected(self, *centers, index=6, interval_s=0.1):
        """After an object at (5, 1, 0) moved by (1, 0, 0) in the tenth after sweep 5."""
        memory, current = memory_after(5)
        followed(memory, current, object_at((5, 1, 0)), rows((1, 0, 0)), 0.1)
        self.world_from_first = current.pose.world_from_sensor
        (later,) = memory.prepared(sweep(index))
        self.sensor_from_first = np.linalg.inv(later.pose.world_from_sensor) @ (
            self.world_from_first
        )
        seen = [
            self.sensor_from_first[:3, :3] @ center + self.sensor_from_first[:3, 3]
            for center in centers
        ]
        return memory.expected(later, object_at(*seen), interval_s).motions

    def test_motion_goes_on_in_the_frame_of_the_later_sweep(self):
        found = self.expected((6, 1, 0), (9, 9, 0))
        turn = self.sensor_from_first[:3, :3]
        np.testing.assert_allclose(found, [turn @ (1, 0, 0), (0, 0, 0)], atol=1e-5)

    def test_object_is_looked_for_where_it_should_be_by_now(self):
        assert self.expected((8, 1, 0), index=8).any()
        assert not self.expected((5, 1, 0), index=8).any()

    def test_motion_is_in_proportion_to_the_interval(self):
        found = self.expected((6, 1, 0), interval_s=0.25)
        assert np.linalg.norm(found) == pytest.approx(2.5, abs=1e-4)

    @pytest.mark.parametrize(("away_m", "is_same"), [(0.4, True), (0.6, False)])
    def test_object_is_the_same_within_half_a_metre(self, away_m, is_same):
        assert self.expected((6, 1 + away_m, 0)).any() == is_same

    def test_nothing_is_expected_where_nothing_moved(self):
        memory, current = memory_after(5)
        assert not memory.expected(current, object_at((5, 1, 0)), 0.1).is_known.any()
        followed(memory, current, object_at(), rows(), 0.1)
        (later,) = memory.prepared(sweep(6))
        assert not memory.expected(later, object_at((5, 1, 0)), 0.1).is_known.any()
