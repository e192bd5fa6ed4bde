# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Each assumption about the input: said where it does not hold, and only there."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.input_check.finding import Severity
from mnsf_ros.input_check.imu_fit import ImuFit
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.odometry_fit import OdometryFit
from mnsf_ros.input_check.sweep_sample import Located, Step
from mnsf_ros.settings import Settings, TimeSettings
from mnsf_ros.simulation.imu import turn_rates
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from msg_utils.point_cloud2 import encode_columns

NUM_SWEEPS = 25


@dataclass(frozen=True, eq=False)
class Cloud:
    """A cloud of the simulator, and where it was taken."""

    stamp_ns: int
    xyz: np.ndarray
    columns: dict
    pose: np.ndarray
    odometry: np.ndarray | None = None

    def rows(self, rows):
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(self, xyz=self.xyz[rows], columns=columns)

    def with_times(self, name, values):
        return replace(self, columns={"ring": self.columns["ring"], name: values})

    def moved(self, matrix):
        xyz = self.xyz @ matrix[:3, :3].T + matrix[:3, 3]
        return replace(self, xyz=xyz, pose=self.pose @ np.linalg.inv(matrix))

    def with_points(self, xyz):
        return replace(self, xyz=np.concatenate([self.xyz, xyz]), columns={})

    @property
    def sweep(self):
        axes = {axis: self.xyz[:, i].astype(np.float32) for i, axis in enumerate("xyz")}
        encoded = encode_columns({**axes, **self.columns}, 1, len(self.xyz))
        sec, nanosec = divmod(self.stamp_ns, 10**9)
        stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
        header = SimpleNamespace(stamp=stamp, frame_id="lidar")
        message = SimpleNamespace(**vars(encoded), data=encoded.data, header=header)
        sweep = CloudReader().sweep(message, TimeSettings(), 0)
        return replace(sweep, odometry=self.odometry)


@cache
def street(is_rolling=True):
    """Clouds of a street at 8 m/s."""
    settings = SimulationSettings(num_beams=32, num_columns=450, duration_s=0.1 * NUM_SWEEPS)
    simulator = SweepSimulator(settings)
    sensor = replace(simulator.scene.sensor, is_rolling=is_rolling)
    simulator.scene = replace(simulator.scene, sensor=sensor)
    return [
        Cloud(one.truth.stamp_ns, one.xyz, {k: one.columns[k] for k in columns}, one.pose)
        for one in simulator
        for columns in [[name for name in one.columns if name != "intensity"]]
    ]


def checked(clouds, num_own=0, reach_m=0.0, num_parts=1, *, is_turning=None):
    own_body = np.full((num_own, 3), (reach_m, 0.0, 0.0), np.float32)
    mounting, rotation = MountingEstimate(), LidarRotation()
    rotation.is_found = is_turning
    check = InputCheck(Settings(), mounting, rotation)
    for cloud in clouds:
        sweep = mounting.mounted(cloud.sweep, Settings())
        check.add(sweep, num_parts)
        check.locate(Located(sweep, cloud.pose, "registration", own_body))
    return check


def wrong(clouds, *own):
    return [finding for finding in checked(clouds, *own).findings() if finding.is_wrong]


def turned(axis, degrees):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return matrix


def shifted(x, z):
    matrix = np.eye(4)
    matrix[[0, 2], 3] = x, z
    return matrix


def of_seconds(cloud, factor, step=0.0):
    seconds = factor * cloud.columns["t"] / 1e9
    seconds = step * np.round(seconds / step) if step else seconds
    return cloud.with_times("time", seconds.astype(np.float32))


def few_early(cloud, number):
    rows = np.random.default_rng(number).random(len(cloud.xyz)) < 0.005
    return cloud.with_times("t", np.where(rows, 0, cloud.columns["t"]).astype(np.uint32))


def in_unit(cloud, number):
    return replace(cloud, xyz=cloud.xyz * number)


def late_stamp(cloud, number):
    return replace(cloud, stamp_ns=cloud.stamp_ns + (37 * number) % 5 * 8_000_000)


def late_with_absolute_times(cloud, number):
    seconds = (cloud.stamp_ns + cloud.columns["t"].astype(np.int64)) / 1e9
    return late_stamp(cloud.with_times("timestamp", seconds), number)


def shell(cloud, number):
    near = cloud.rows(np.linalg.norm(cloud.xyz, axis=1) < 30)
    rng = np.random.default_rng(number)
    azimuths, elevations = rng.uniform(-3, 3, 1000), rng.uniform(0.0, 0.3, 1000)
    across = np.cos(elevations)
    rays = [across * np.cos(azimuths), across * np.sin(azimuths), np.sin(elevations)]
    return near.with_points(30.0 * np.stack(rays, axis=1))


def two_lenses(cloud, _):
    other = cloud.moved(shifted(4.0, 0.0))
    columns = {"ring": np.tile(cloud.columns["ring"], 2)}
    return replace(cloud, xyz=np.concatenate([cloud.xyz, other.xyz]), columns=columns)


def odd_odometry(cloud, number):
    return replace(cloud, odometry=cloud.pose @ turned("z", 3.0 * (number % 2)))


DISTURBED = {
    "no number of a clock": (lambda one, _: of_seconds(one, 100.0), "field 'time': values from"),
    "millimetres": (lambda one, _: in_unit(one, 1000), "Divide the coordinates by 1000"),
    "centimetres": (lambda one, _: in_unit(one, 100), "Divide the coordinates by 100,"),
    "UTM": (lambda one, _: one.moved(shifted(500_000.0, 0.0)), "the origin of the frame is 500,0"),
    "an eighth": (lambda one, _: of_seconds(one, 0.125), "set time.field=clockwise:"),
    "rounded": (lambda one, _: of_seconds(one, 1.0, 0.01), "only 11 different values"),
    "late stamps": (late_stamp, "ms off an even clock"),
    "late stamps, even points": (late_with_absolute_times, "but the first points only 0 ms"),
    "on its side": (lambda one, _: one.moved(turned("x", 90)), "z is 90 degrees off the normal"),
    "base_link, no beams": (
        lambda one, _: replace(one.moved(shifted(1.4, 1.8)), columns={}),
        "the origin is 0.",
    ),
    "two lenses": (two_lenses, "degrees off cones around the origin, and no place"),
    "odometry": (odd_odometry, "odometry contradicts the clouds"),
}


@pytest.mark.parametrize("name", DISTURBED)
def test_what_does_not_fit_is_said(name):
    disturb, text = DISTURBED[name]
    findings = wrong([disturb(cloud, number) for number, cloud in enumerate(street())])
    assert any(text in str(finding) for finding in findings), findings
    # The cause is not hidden by its effects.
    assert len(findings) <= 2


NOTED = {
    "upside down": (lambda one, _: one.moved(turned("x", 180)), "up is nearest to -z; methods get"),
    "tilted": (lambda one, _: one.moved(turned("y", 45)), "z is 45 degrees off the normal"),
    "tilted a little": (
        lambda one, _: one.moved(turned("y", 10)),
        "z is 10 degrees off the normal",
    ),
    "base_link": (lambda one, _: one.moved(shifted(1.4, 1.8)), "but at 1.40, 0.00, 1.80 m"),
}


@pytest.mark.parametrize("name", NOTED)
def test_what_methods_can_take_is_a_note(name):
    disturb, text = NOTED[name]
    check = checked([disturb(cloud, number) for number, cloud in enumerate(street())])
    assert any(text in finding.found for finding in check.findings())
    assert not any(finding.is_wrong for finding in check.findings())


def test_parts_of_a_revolution_are_a_note():
    (finding,) = checked([one.rows(np.arange(3000)) for one in street()], num_parts=4).findings()
    assert "are parts of a revolution: 4 are put together" in finding.found
    assert not finding.is_wrong


def test_an_own_body_is_wrong_where_the_search_for_it_ends():
    assert checked(street(), 130, 1.6).facts()["own body"] == "130 points within 1.6 m, left out"
    assert not wrong(street(), 130, 1.6)
    (finding,) = wrong(street(), 130, 1.9)
    assert "own body: 130 points within 1.9 m" in finding.found


CORRECTED = {
    "from 0 to 1": lambda one, _: of_seconds(one, 10.0),
    "milliseconds": lambda one, _: of_seconds(one, 1000.0),
    "early points": few_early,
    "zeros": lambda one, _: one.with_points(np.zeros((500, 3))),
    "shell": shell,
}


def windows(number):
    """Each cloud with the points of the last ones, and absolute times."""
    clouds = [
        replace(one, stamp_ns=10**18 + 10**8 * k)
        for k, one in enumerate([*street(), *reversed(street())])
    ]
    for several in zip(*(clouds[k:] for k in range(number)), strict=False):
        xyz = np.concatenate([one.xyz for one in several])
        times = [(one.stamp_ns + one.columns["t"].astype(np.int64)) / 1e9 for one in several]
        yield replace(several[-1], xyz=xyz, columns={"timestamp": np.concatenate(times)})


@pytest.mark.parametrize("number", [2, 3])
def test_clouds_with_points_of_those_before_are_said_with_a_remedy_that_helps(number):
    findings = wrong(windows(number))
    assert any(f"has those of {number} sweeps" in one.found for one in findings)
    assert not any("time.field" in one.remedy for one in findings)


def test_a_lidar_with_coarse_ranges_that_stands_has_new_points():
    """As none moves and ranges are coarse, four fifths of the points are as always."""
    rng, first = np.random.default_rng(0), street()[0]
    clouds = [
        replace(
            first,
            stamp_ns=10**18 + 10**8 * k,
            xyz=np.where(rng.random((len(first.xyz), 1)) < 0.8, first.xyz, first.xyz * 1.001),
        )
        for k in range(40)
    ]
    assert not any("cloud before" in one.found for one in wrong(clouds))


@pytest.mark.parametrize("number", [2, 3])
def test_lidars_in_turn_on_one_topic_are_said(number):
    clouds = [one.moved(turned("z", 360 / number * (k % number))) for k, one in enumerate(street())]
    assert any(f"clouds show {number} views in turn" in one.found for one in wrong(clouds))


def test_keyframes_are_no_fault_of_the_clock():
    clouds, stamps_s = street(), np.cumsum(0.15 + 0.1 * np.sin(np.arange(NUM_SWEEPS) / 4))
    clouds = [
        replace(one, stamp_ns=10**18 + int(1e9 * stamp_s))
        for one, stamp_s in zip(clouds, stamps_s, strict=True)
    ]
    findings = checked(clouds).findings()
    assert any("clouds come at uneven intervals of 0.0" in one.found for one in findings)
    assert not any("clock" in one.found for one in findings)


def test_intervals_that_are_too_long_are_said_with_the_value():
    clouds = [
        replace(one, stamp_ns=10**18 + 5 * 10**8 * k + 2 * 10**7 * (k % 2))
        for k, one in enumerate(street())
    ]
    (finding,) = [one for one in wrong(clouds) if "intervals between clouds" in one.found]
    assert "12 of 24 intervals between clouds are longer than 0.5 s" in finding.found
    assert finding.remedy == "Set buffer.max_interval_s=0.6"


@pytest.mark.parametrize("name", CORRECTED)
def test_what_is_corrected_when_it_is_read_is_no_fault(name):
    clouds = [CORRECTED[name](cloud, number) for number, cloud in enumerate(street())]
    assert not wrong(clouds)


@pytest.mark.parametrize("is_rolling", [False, True])
def test_an_undisturbed_street_has_no_fault(is_rolling):
    clouds = [replace(cloud, odometry=cloud.pose) for cloud in street(is_rolling)]
    assert not wrong(clouds)


@pytest.mark.parametrize("degrees", [0, 10, 20])
def test_a_tilt_that_works_is_no_fault(degrees):
    assert not wrong([cloud.moved(turned("y", degrees)) for cloud in street()])


def test_without_times_it_cannot_be_known_whether_the_lidar_turns():
    (finding,) = checked(street(is_rolling=False)).findings()
    assert not finding.is_wrong
    assert "points have no times, and the sensor moves at 8.0 m/s" in finding.found
    assert "publish the time of each point" in finding.remedy
    assert "clockwise" not in finding.remedy


def test_times_that_the_stream_found_are_said():
    check = checked(street(is_rolling=False), is_turning=True)
    (finding,) = check.findings()
    assert not finding.is_wrong
    assert "points have no times, but the lidar turns" in finding.found
    assert "by the order of the points" in check.facts()["times of points"]


def test_facts_describe_the_stream():
    facts = checked(street()).facts()
    assert facts["rate"].startswith("10.0 Hz")
    assert facts["times of points"].endswith("100.0 ms a cloud, in order of azimuth")
    assert facts["field of view"].endswith("-25 to 2 degrees up")
    assert "origin 1.5" in facts["mounting"]
    assert facts["beams"] == "32"
    assert facts["own body"] == "none"


def test_gaps_are_said_beside_the_rate():
    clouds = street()
    assert "gaps" not in checked(clouds).facts()["rate"]
    cut = [*clouds[:8], *clouds[11:]]
    assert checked(cut).facts()["rate"].endswith("even clock; gaps: 1, up to 0.4 s")


@pytest.mark.parametrize("number", [0, 1, 3])
def test_too_few_points_are_the_one_fault(number):
    clouds = [cloud.rows(np.arange(number)) for cloud in street(is_rolling=False)[:2]]
    check = checked(clouds)
    (finding,) = wrong(clouds)
    assert f"a cloud has {number} measured points" in finding.found
    assert check.facts()["frame"] == "lidar"
    assert not InputCheck(Settings(), MountingEstimate(), LidarRotation()).findings()


@pytest.mark.parametrize("factor", [0.0, 1e-30, 3e37])
def test_points_and_times_of_any_size_are_taken(factor):
    rng = np.random.default_rng(0)
    check = InputCheck(Settings(), MountingEstimate(), LidarRotation())
    for number in range(30):
        xyz = np.float32(factor) * rng.normal(0, 1, (100, 3)).astype(np.float32)
        times_s = np.float32(number % 2) * rng.uniform(-2, 2, 100).astype(np.float32)
        sweep = Sweep(xyz, 10**8 * (number % 20), times_s=times_s, odometry=np.eye(4))
        pose = np.diag((1.0, 1.0, 1.0, 1.0))
        pose[0, 3] = number**2
        check.add(sweep)
        check.locate(Located(sweep, pose, "registration"))
        check.facts()
    assert all(finding.remedy for finding in check.findings())


@cache
def weaving():
    """Sweeps with turn rates, and their poses; the points hardly matter."""
    settings = SimulationSettings(seed=2, scenario="turns", duration_s=2.5)
    simulator = SweepSimulator(settings)
    ego, times_s = simulator.scene.ego, np.arange(25) / 10
    turns_s = np.arange(-1.0, 2.6, 0.005)
    rates = turn_rates(ego, turns_s, 200.0, np.random.default_rng(0))
    return [
        (time_s, ego.world_from_sensor(time_s), np.column_stack([turns_s - time_s, rates]))
        for time_s in times_s
    ]


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda rates: rates, None),
        (lambda rates: rates * [1, *3 * [180 / np.pi]], "degrees/s"),
        (lambda rates: rates * [1, -1, -1, -1], "correlation of -"),
        (lambda rates: rates[:, [0, 2, 3, 1]], "contradict the clouds"),
        (lambda rates: rates[:0], None),
    ],
    ids=["good", "degrees", "negative", "other axes", "none"],
)
def test_turn_rates_that_contradict_the_clouds_are_said(spoil, text):
    check, cloud = InputCheck(Settings(), MountingEstimate(), LidarRotation()), street()[0]
    for time_s, pose, rates in weaving():
        stamped = replace(cloud, stamp_ns=10**18 + round(time_s * 1e9)).sweep
        check.add(stamped)
        turning = stamped.turning(spoil(rates), np.eye(4))
        check.locate(Located(turning, pose, "registration"))
    (imu,) = (one for one in check._by_registration if isinstance(one, ImuFit))
    found = [str(finding) for finding in imu.findings()]
    assert bool(found) == (text is not None)
    assert text is None or text in found[0]
    assert ("IMU" in check.facts()) == (text is None and len(spoil(weaving()[0][2])) > 0)


@pytest.mark.parametrize(
    ("has_walls", "severity", "text"),
    [
        (True, Severity.ERROR, "and static points fit odometry: they are off by 0.00 m"),
        (False, Severity.WARNING, "and the clouds do not tell which is right"),
    ],
)
def test_odometry_and_registration_that_differ_in_most_sweeps_are_said(has_walls, severity, text):
    """The sensor moves by 0.62 m a sweep, and registration takes it to be at rest."""
    fit, rng, located = OdometryFit(Settings().ego_motion), np.random.default_rng(0), []
    places = rng.uniform((-30, -30, -2), (30, 30, 3 if has_walls else -2), (5000, 3))
    for number in range(20):
        moved = shifted(0.62 * number, 0.0)
        own = rng.uniform((-30, -30, -2), (30, 30, -2), (20_000, 3))
        xyz = places - moved[:3, 3] if has_walls else own
        sweep = Sweep(xyz.astype(np.float32), number * 10**8, odometry=moved)
        located.append(Located(sweep, np.eye(4), "registration"))
    for before, after in pairwise(located):
        fit.move(Step(before, after))
    (finding,) = fit.findings()
    assert finding.severity is severity
    assert text in finding.found
    assert "differ in 100% of the sweeps, by 0.62 m" in finding.found
