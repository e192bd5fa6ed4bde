# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Faults of a lidar that begin while it runs are told in time, and no change of place is."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.episodes import LIVE_MEMORY
from mnsf_ros.input_check.finding import Severity
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.settings import Settings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Sweep

BEGIN, END = 30, 50
FIRST_NS = 10**18


def stamp_ns(number):
    return FIRST_NS + 10**8 * number


@cache
def street():
    """Sweeps of a street at 8 m/s."""
    settings = SimulationSettings(num_beams=32, num_columns=450, duration_s=0.1 * END)
    return [
        Sweep(one.xyz, stamp_ns(number), "lidar")
        for number, one in enumerate(SweepSimulator(settings))
    ]


def azimuths(sweep):
    return np.degrees(np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]))


def ranges(sweep):
    return np.linalg.norm(sweep.xyz, axis=1)


def scaled(sweep, factors):
    return replace(sweep, xyz=(sweep.xyz * factors).astype(np.float32))


def some(sweep, share):
    return np.random.default_rng(sweep.stamp_ns).random(len(sweep)) < share


def frozen(sweep, *, among):
    number = (sweep.stamp_ns - FIRST_NS) // 10**8
    return replace(street()[BEGIN - 1 - number % among], stamp_ns=sweep.stamp_ns)


def in_fog(sweep, low_m=1.0, high_m=4.0):
    to_m = np.random.default_rng(sweep.stamp_ns).uniform(low_m, high_m, len(sweep))
    nearer = np.where(some(sweep, 0.7), np.minimum(1.0, to_m / ranges(sweep)), 1.0)
    return scaled(sweep, nearer[:, None])


def behind_a_hand(sweep):
    covered = np.abs(azimuths(sweep)) < 126
    return scaled(sweep, np.where(covered, 0.15 / ranges(sweep), 1.0)[:, None])


def twice_in_turn(sweep):
    number = (sweep.stamp_ns - FIRST_NS) // 10**8
    return replace(street()[number - number % 2], stamp_ns=sweep.stamp_ns)


# What happens, what is said, and how many clouds after it began, at most.
FAULTS = {
    "the last cloud again": (lambda one: frozen(one, among=1), "those of an earlier cloud", 3),
    "two in turn": (lambda one: frozen(one, among=2), "those of an earlier cloud", 3),
    "three in turn": (lambda one: frozen(one, among=3), "those of an earlier cloud", 5),
    "each one twice": (twice_in_turn, "those of an earlier cloud", 6),
    "front half": (
        lambda one: one.part(np.abs(azimuths(one)) > 90),
        "180 degrees around azimuth 0 have no returns any more",
        3,
    ),
    "a sector behind": (
        lambda one: one.part(np.abs(azimuths(one)) < 140),
        "degrees around azimuth 180 have no returns any more",
        3,
    ),
    "few points": (lambda one: one.part(some(one, 0.02)), "only 2.", 3),
    "fog": (in_fog, "of the returns are within 4 m", 3),
    "a hand": (behind_a_hand, "of the returns are within 4 m", 3),
    "halved": (lambda one: scaled(one, 0.5), "all ranges became 0.5 times", 3),
    "millimetres": (lambda one: scaled(one, 1000.0), "all ranges became 1e+03 times", 3),
    "mirrored": (lambda one: scaled(one, [1, -1, 1]), "clouds are mirrored", 16),
    "x and y swapped": (
        lambda one: replace(one, xyz=one.xyz[:, [1, 0, 2]]),
        "clouds are mirrored",
        16,
    ),
}


def new_check(**options):
    return InputCheck(Settings(), MountingEstimate(), LidarRotation(), **options)


def wrong(check):
    return [finding for finding in check.findings() if finding.is_wrong]


def added(clouds, check=None):
    check = check or new_check()
    for cloud in clouds:
        check.add(cloud)
    return check


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_in_time_and_after_it(name):
    spoil, text, most = FAULTS[name]
    check = added(street()[:BEGIN])
    assert not wrong(check)
    added(map(spoil, street()[BEGIN : BEGIN + most]), check)
    (finding,) = wrong(check)
    assert text in finding.found
    # In a recording it is told to the end.
    added(street()[BEGIN + most :], check)
    assert any(text in one.found for one in wrong(check))


def test_a_fault_is_an_alarm_while_it_lasts_and_live_it_is_forgotten():
    check = added(street()[:BEGIN], new_check(is_live=True))
    assert not check.is_alarm
    added([frozen(one, among=1) for one in street()[BEGIN : BEGIN + 3]], check)
    assert check.is_alarm
    added(street()[BEGIN + 3 : BEGIN + 10], check)
    assert not check.is_alarm
    assert wrong(check)
    later = (replace(one, stamp_ns=one.stamp_ns + 10**10) for one in 3 * street())
    added((one for one, _ in zip(later, range(LIVE_MEMORY), strict=False)), check)
    assert not wrong(check)


def test_fog_from_the_first_cloud_on_is_told():
    (finding,) = wrong(added(map(in_fog, street()[:10])))
    assert "fog, spray or dust" in finding.remedy
    assert finding.severity is Severity.WARNING


def test_a_cloud_that_is_delivered_twice_is_no_fault():
    clouds = [*street()[:BEGIN], frozen(street()[BEGIN], among=1), *street()[BEGIN + 1 :]]
    assert not wrong(added(clouds))


def test_clouds_that_come_twice_under_their_own_stamp_are_duplicates():
    assert not wrong(added(one for one in street()[:10] for _ in range(2)))


def test_another_place_after_a_gap_is_no_fault():
    after = [
        replace(behind_a_hand(one), stamp_ns=one.stamp_ns + 2 * 10**9) for one in street()[BEGIN:]
    ]
    assert not wrong(added([*street()[:BEGIN], *after]))


def test_an_open_side_that_opens_and_closes_is_no_fault():
    """As in a square without returns that a lidar turns in: the side was not steady before."""
    clouds = [
        one.part(np.abs((azimuths(one) - 9.0 * number) % 360 - 180) < 130)
        for number, one in enumerate(street())
    ]
    assert not wrong(added(clouds))


def room(number, sizes_m, *, bus_deg=0.0):
    """A sweep of 32 beams between six walls so far away (x, y, z), and a bus so far alongside."""
    around, up = np.meshgrid(
        np.radians(np.arange(0, 360, 0.8)), np.radians(np.linspace(-25, 15, 32))
    )
    directions = np.stack(
        [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1
    )
    with np.errstate(divide="ignore"):
        ranges_m = (np.array(sizes_m) / np.abs(directions)).min(axis=-1)
        bus_m = 1.0 / np.abs(directions[..., 1])
    behind = (around > 0) & (around < np.radians(bus_deg))
    ranges_m = np.where(behind, np.minimum(ranges_m, bus_m), ranges_m)
    ranges_m += np.random.default_rng(number).normal(0.0, 0.02, ranges_m.shape)
    xyz = (directions * ranges_m[..., None]).swapaxes(0, 1).reshape(-1, 3)
    return Sweep(xyz.astype(np.float32), stamp_ns(number), "lidar")


PLACES = {
    "a small room": lambda _: {"sizes_m": (1.5, 1.0, 1.2)},
    "a stop at walls that come near": lambda number: {
        "sizes_m": (max(1.0, 16.0 - number / 2), 3.0, 1.8)
    },
    "a tunnel that is entered": lambda number: {
        "sizes_m": (80.0, np.clip(40.0 - number, 3.0, 20.0), 1.8)
    },
    "a bus that comes alongside": lambda number: {
        "sizes_m": (40.0, 15.0, 1.8),
        "bus_deg": np.clip(12.0 * (number - BEGIN), 0.0, 180.0),
    },
}


@pytest.mark.parametrize("name", PLACES)
def test_a_near_place_is_no_fault(name):
    assert not wrong(added(room(number, **PLACES[name](number)) for number in range(END)))


def received(sweep, age_s):
    times = SimpleNamespace(source="none", fault="")
    message = SimpleNamespace(fields=[], row_step=0, width=0, point_step=0, is_bigendian=False)
    message.height = 1
    cloud = SimpleNamespace(
        message=message,
        measured=np.ones(len(sweep), bool),
        num_untimed=0,
        times=times,
        is_stamped=True,
        received_ns=sweep.stamp_ns + round(1e9 * age_s),
    )
    return replace(sweep, source=cloud)


@pytest.mark.parametrize(
    ("age_s", "text"),
    [
        (0.3, None),
        (-0.3, None),
        (5.0, "stamps are 5.0 s behind the clock of the computer"),
        (-3600.0, "stamps are 60.0 minutes ahead of the clock of the computer"),
        (7 * 86_400.0, None),
        (-7 * 86_400.0, "stamps are 7.0 days ahead of the clock of the computer"),
    ],
)
def test_stamps_of_another_clock_are_told(age_s, text):
    clouds = [received(one, age_s) for one in street()[:10]]
    (*findings,) = wrong(added(clouds, new_check(is_live=True)))
    assert [one.found for one in findings] == ([text] if text else [])
    if text is not None:
        assert findings[0].severity is Severity.ERROR
        assert "PTP or NTP" in findings[0].remedy
        # Flow of a recording is right all the same.
        assert wrong(added(clouds))[0].severity is Severity.WARNING


def test_old_stamps_of_a_recording_that_is_played_are_a_note():
    check = new_check(is_live=True)
    check.is_played = True
    added((received(one, 3600.0) for one in street()[:10]), check)
    assert not wrong(check)
    assert any("use_sim_time" in finding.remedy for finding in check.findings())


def test_one_late_cloud_is_no_clock():
    ages_s = [0.1, 0.1, 5.0, 0.1, 0.1, 0.1, 5.0]
    assert not wrong(added(map(received, street(), ages_s), new_check(is_live=True)))


@pytest.mark.parametrize("step_ns", [0, -(10**8)])
def test_stamps_that_stay_or_go_back_are_of_no_clock(step_ns):
    first = street()[0]
    clouds = [replace(one, stamp_ns=first.stamp_ns + step_ns * k) for k, one in enumerate(street())]
    check = added(map(received, clouds, np.arange(END) / 5), new_check(is_live=True))
    assert not any("clock of the computer" in finding.found for finding in check.findings())


def turning(number, last_s):
    """A sweep with turn rates every 5 ms up to a time after the first sweep."""
    times_s = np.arange(-0.5, 0.05, 0.005)
    own = times_s[times_s + 0.1 * number < last_s]
    rates = np.column_stack([own, np.zeros((len(own), 3))])
    return replace(street()[number], turn_rates=rates)


@pytest.mark.parametrize("last_s", [9.0, 1.5, -9.0])
def test_an_imu_that_stops_is_told(last_s):
    check = new_check()
    for number in range(BEGIN):
        check.locate(Located(turning(number, last_s), np.eye(4), "registration"))
    found = [finding.found for finding in wrong(check)]
    # One that never sent anything was not used.
    assert found == (
        ["turn rates of the IMU ended, or have gaps, in 12 of 29 clouds"] if last_s == 1.5 else []
    )
