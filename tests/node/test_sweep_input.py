# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps with their poses by odometry and TF, of one lidar and of several.

Few machines have tf2_ros: it is replaced, but for one test with the real one.
"""

import importlib.util
import re
import sys
import types

import numpy as np
import pytest
import rclpy
from box_street import INTERVAL_NS, BoxStreet, pose
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from moving_boxes import surfaces
from nav_msgs.msg import Odometry
from node_harness import QUICK, Spinner, stamp_of
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, PointCloud2
from std_msgs.msg import Header
from synthetic_clouds import column, over_ground, xyz_columns, xyz_message

from mnsf_ros.geometry.transforms import pose_matrix, transform_matrix
from mnsf_ros.node import sweep_input
from mnsf_ros.node.sweep_input import SweepInput
from mnsf_ros.node.transforms import OdometryFrame, TransformError, Transforms
from mnsf_ros.settings import Settings

# Columns of a merged cloud beside those of its lidars.
ADDED = ("time", "lidar")
HAS_TF2 = importlib.util.find_spec("tf2_ros") is not None


class Tf2(types.ModuleType):
    """The parts of tf2_ros that the node uses.

    Attributes:
        found: Target frame, source frame and stamp (0: newest) to x of the transform, metres.
        is_upside_down: Whether they have half a turn about x, too.
        num_clears: How often the buffer was cleared.
        sent: Transforms that were broadcast.
    """

    TransformException = LookupError

    def __init__(self):
        super().__init__("tf2_ros")
        self.found, self.num_clears, self.sent = {}, 0, []
        self.is_upside_down = False

    def Buffer(self):  # noqa: N802 - as in tf2_ros
        return self

    def TransformListener(self, _buffer, _node):  # noqa: N802
        return types.SimpleNamespace(unregister=lambda: None)

    def TransformBroadcaster(self, _node):  # noqa: N802
        return types.SimpleNamespace(sendTransform=self.sent.append)

    def clear(self):
        self.num_clears += 1

    def _getFrameStrings(self):  # noqa: N802
        return sorted({frame for names in self.found for frame in names[:2]})

    def lookup_transform(self, target, source, stamp):
        message = TransformStamped()
        message.transform.translation.x = self.found[target, source, stamp.nanoseconds]
        turn = message.transform.rotation
        turn.x, turn.w = (1.0, 0.0) if self.is_upside_down else (0.0, 1.0)
        return message


class Input(Spinner):
    """The input under test, the lidars in front of it, and the sweeps behind it."""

    def __init__(self, changes):
        super().__init__("input")
        self.sweeps, self.events, self.breaks = [], [], []
        settings = Settings().changed({"node.input_reliability": "reliable"} | changes)
        self.input = SweepInput(
            self.node,
            settings,
            self._report,
            self._on_sweep,
            on_break=lambda: self.breaks.append(True),
        )
        topics = ["~/points", "~/points_2"][: settings.lidars.count]
        self._publishers = [self.advertised(PointCloud2, topic) for topic in topics]

    def advertised(self, message_type, topic):
        """A publisher that the input hears."""
        publisher = self.node.create_publisher(message_type, topic, 100)
        self.spin_until(lambda: publisher.get_subscription_count() == 1, f"a subscriber of {topic}")
        return publisher

    def _report(self, event, _text, how_many=1):
        self.events.append(event)

    def _on_sweep(self, sweep, _arrived_ns):
        self.sweeps.append(sweep)

    def publish(self, *clouds, lidar=0):
        for cloud in clouds:
            self._publishers[lidar].publish(cloud)

    def wait_for_sweeps(self, number):
        self.spin_until(lambda: len(self.sweeps) == number, f"{number} sweeps")


@pytest.fixture
def tf2(monkeypatch):
    module = Tf2()
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return module


@pytest.fixture
def make(ros, tf2):
    made = []

    def make(**changes):
        made.append(Input({name.replace("__", "."): value for name, value in changes.items()}))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def clock_ns(monkeypatch):
    """The time of the input, in a list of one."""
    now_ns = [0]
    clock = types.SimpleNamespace(monotonic_ns=lambda: now_ns[0])
    monkeypatch.setattr(sweep_input, "time", clock)
    return now_ns


def test_sweeps_wait_for_their_transform_in_order_and_for_a_time(make, tf2, drive, clock_ns):
    lidar = make(ego_motion__source="tf", tf__timeout_s=0.5)
    lidar.publish(*drive.sweeps(0, 1))
    tf2.found["odom", "lidar", drive.stamp_ns(1)] = 2.0
    lidar.spin_until(lambda: len(lidar.input._waiting) == 2, "two that wait")
    # The second one has its transform, and waits behind the first.
    assert lidar.sweeps == []
    tf2.found["odom", "lidar", drive.stamp_ns(0)] = 1.0
    lidar.wait_for_sweeps(2)
    assert [sweep.odometry[0, 3] for sweep in lidar.sweeps] == [1.0, 2.0]
    lidar.publish(drive.sweep(2))
    lidar.spin_until(lambda: lidar.input._waiting, "one that waits")
    assert lidar.events == []
    clock_ns[0] += 500_000_000
    lidar.wait_for_sweeps(3)
    assert lidar.sweeps[2].odometry is None
    assert lidar.events == ["transforms_missing"]


def test_the_fixed_frame_may_be_in_a_namespace(ros, tf2):
    def of(*frames):
        tf2.found = {(frame, "lidar", 0): 1.0 for frame in frames}
        return Transforms(None, "a test").fixed_frame("/odom")

    assert of("odom", "a/odom") == "odom"
    assert of("a/odom", "map", "odometer") == "a/odom"
    with pytest.raises(TransformError, match=r"\['a/odom', 'b/odom', 'lidar'\]: name one with tf"):
        of("a/odom", "b/odom")
    with pytest.raises(TransformError, match=r"TF has no frame 'odom', but \[\]"):
        of()


def test_the_mounting_is_looked_up_and_kept(make, tf2, drive):
    it = make(ego_motion__source="tf", tf__timeout_s=0.0)
    it.publish(drive.sweep(0))
    it.wait_for_sweeps(1)
    tf2.is_upside_down, tf2.found["base_link", "lidar", 0] = True, 1.0
    it.publish(drive.sweep(1))
    it.wait_for_sweeps(2)
    tf2.is_upside_down = False
    it.publish(drive.sweep(2), drive.sweep(3, frame_id="base_link"))
    it.wait_for_sweeps(4)
    unknown, found, kept, in_base = (sweep.mounting for sweep in it.sweeps)
    assert unknown is in_base is None
    assert kept is found
    np.testing.assert_allclose(found.level_from_sensor, np.diag([1, -1, -1, 1]), atol=1e-12)


def test_sectors_are_put_together_with_all_their_points(make, drive):
    it = make()
    whole = surfaces(0, 4000)
    quarters = np.floor(np.arctan2(whole[:, 1], whole[:, 0]) / (np.pi / 2)).astype(int) % 4
    for done, numbers in enumerate([(0, 1, 2, 3), (4, 5), (6, 7, 8, 9)], start=1):
        for number in numbers:
            part = whole[quarters == number % 4]
            it.publish(xyz_message(part, stamp_ns=drive.stamp_ns(number / 4)))
        it.wait_for_sweeps(done)
    first, one, two = it.sweeps
    assert it.breaks == [True]
    assert len(first) == np.count_nonzero(quarters == 0)
    assert len(one) == len(two) == len(whole)
    assert [sweep.stamp_ns for sweep in (one, two)] == [drive.stamp_ns(n) for n in (0.25, 1.25)]
    message = one.source.message
    assert stamp_of(message) == one.stamp_ns
    order = np.concatenate([np.flatnonzero(quarters == n) for n in (1, 2, 3, 0)])
    np.testing.assert_array_equal(xyz_columns(message), whole[order])
    own = np.concatenate([np.arange(np.count_nonzero(quarters == n)) for n in (1, 2, 3, 0)])
    np.testing.assert_array_equal(column(message, "intensity"), own)
    np.testing.assert_allclose(
        np.unique(column(message, "time")), [0, 0.025, 0.05, 0.075], atol=1e-6
    )
    assert it.input.state.num_parts == 4


def test_a_clock_that_jumps_back_clears_the_transforms(make, tf2, drive):
    lidar = make(ego_motion__source="tf", tf__timeout_s=0.0)
    lidar.publish(*drive.sweeps(0, 20, 15))
    lidar.wait_for_sweeps(3)
    assert tf2.num_clears == 0
    lidar.publish(drive.sweep(0))
    lidar.wait_for_sweeps(4)
    assert tf2.num_clears == 1


def test_odometry_is_of_a_frame_whose_lidar_is_looked_up(make, tf2, drive):
    lidar = make(ego_motion__source="odometry", ego_motion__sensor_pose="tf")
    odometry = lidar.advertised(Odometry, "~/odometry")
    for index in range(3):
        message = Odometry(child_frame_id="base_link", header=drive.sweep(index).header)
        message.pose.pose.orientation.w = 1.0
        message.pose.pose.position.x = 10.0 + index
        odometry.publish(message)
    track = lidar.input._odometry._track
    lidar.spin_until(lambda: track.pose_at(drive.stamp_ns(2)) is not None, "the odometry")
    lidar.publish(drive.sweep(0))
    lidar.wait_for_sweeps(1)
    assert lidar.sweeps[0].odometry is None
    assert lidar.events == ["transforms_missing"]
    tf2.found["base_link", "lidar", 0] = 0.5
    lidar.publish(drive.sweep(1))
    lidar.wait_for_sweeps(2)
    assert lidar.sweeps[1].odometry[0, 3] == 11.5


def test_odometry_that_is_invalid_or_not_newer_is_left_out_and_counted(make, drive):
    lidar = make(ego_motion__source="odometry")
    odometry = lidar.advertised(Odometry, "~/odometry")
    for index, (x, w) in enumerate([(0.0, np.nan), (1e300, 1.0), (0.0, 1.0), (0.0, 1.0)]):
        message = Odometry(header=drive.sweep(max(index, 3)).header)
        message.pose.pose.position.x, message.pose.pose.orientation.w = x, w
        odometry.publish(message)
    lidar.spin_until(lambda: len(lidar.events) == 3, "all events")
    assert lidar.events == 2 * ["odometry_undecodable"] + ["odometry_out_of_order"]
    lidar.publish(drive.sweep(3))
    lidar.wait_for_sweeps(1)
    np.testing.assert_array_equal(lidar.sweeps[0].odometry, np.eye(4))


class TestImu:
    """Turn rates on ~/imu, in the frame of the cloud."""

    @staticmethod
    def send(it, publisher, drive, rates, frame_id="imu", first_ms=-20, step_ms=10):
        """Rates, from a time after the first sweep on; waits until they are there."""
        track, before = it.input._imu._track, len(it.input._imu._track) + len(it.events)
        for number, rate in enumerate(rates):
            message = Imu()
            ahead_ns = (first_ms + number * step_ms) * 1_000_000
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(drive.stamp_ns(0) + ahead_ns, 10**9)
            message.header.frame_id = frame_id
            message.orientation_covariance[0] = -1.0
            vector = message.angular_velocity
            vector.x, vector.y, vector.z = rate
            publisher.publish(message)
        number = before + len(rates)
        it.spin_until(lambda: len(track) + len(it.events) == number, "the turn rates")

    def test_is_turned_by_its_place_and_ignored_without_one(self, make, tf2, drive):
        it = make()
        it.publish(drive.sweep(0))
        it.wait_for_sweeps(1)
        assert it.input.state.imu == "none"
        publisher = it.advertised(Imu, "~/imu")
        self.send(it, publisher, drive, 20 * [(0.1, 0.2, 0.3)])
        assert it.input.state.imu == "100 Hz, frame 'imu'"
        it.publish(drive.sweep(1))
        it.wait_for_sweeps(2)
        tf2.found["lidar", "imu", 0], tf2.is_upside_down = 0.0, True
        it.publish(drive.sweep(1.1))
        it.wait_for_sweeps(3)
        without, unplaced, placed = it.sweeps
        assert without.turn_rates is unplaced.turn_rates is None
        assert it.events == ["imu_without_transform"]
        np.testing.assert_allclose(placed.turn_rates[:, 1:], 14 * [[0.1, -0.2, -0.3]], atol=1e-9)
        np.testing.assert_allclose(placed.turn_rates[-1, 0], 0.0, atol=1e-3)

    def test_that_is_silent_has_no_rate(self, make, drive):
        it = make()
        publisher = it.advertised(Imu, "~/imu")
        self.send(it, publisher, drive, 20 * [(0.1, 0.2, 0.3)], frame_id="lidar")
        it.spin_until(lambda: "silent" in it.input.state.imu, "silence")
        assert it.input.state.imu == "silent for 1 s, frame 'lidar'"

    def test_of_the_frame_of_the_lidar_needs_no_transforms(self, make, drive):
        it = make()
        publisher = it.advertised(Imu, "~/imu")
        self.send(it, publisher, drive, 20 * [(0.1, 0.2, 0.3)], frame_id="lidar")
        it.publish(drive.sweep(1))
        it.wait_for_sweeps(1)
        np.testing.assert_allclose(it.sweeps[0].turn_rates[0, 1:], [0.1, 0.2, 0.3])

    def test_bad_messages_are_left_out_and_counted(self, make, drive):
        it = make()
        publisher = it.advertised(Imu, "~/imu")
        rates = [(0.0, 0.0, 0.1), (np.nan, 0.0, 0.0), (0.0, 0.0, 0.1)]
        self.send(it, publisher, drive, rates, frame_id="lidar", step_ms=0)
        assert it.events == ["imu_undecodable", "imu_out_of_order"]
        self.send(it, publisher, drive, 8 * [(0.0, 0.0, 0.1)], frame_id="lidar", first_ms=10)
        it.events.clear()
        # The rates end long before this sweep.
        it.publish(drive.sweep(3))
        it.wait_for_sweeps(1)
        assert it.events == ["sweeps_without_turn_rates"]

    def test_can_be_switched_off(self, make):
        it = make(ego_motion__imu=False)
        publisher = it.node.create_publisher(Imu, "~/imu", 10)
        it.spin_for(0.1)
        assert publisher.get_subscription_count() == 0


@pytest.mark.parametrize("name", ["rosbag2_player", "mnsf_play", "driver"])
def test_players_of_recordings_are_known_by_their_name(make, name):
    it = make()
    player = rclpy.create_node(name)
    player.create_publisher(PointCloud2, "/input/points", 10)
    it.spin_until(lambda: it.input.state.num_publishers == 2, "the player")
    assert it.input.is_played == (name != "driver")
    player.destroy_node()


class TestSeveralLidars:
    def test_are_merged_by_their_places_and_left_out_without_one(self, make, tf2, drive):
        lidars = make(lidars__count=2, lidars__frame="body", lidars__max_wait_s=1.0)
        tf2.found["body", "front", 0] = 1.0
        for index in range(2):
            for number, frame in enumerate(("front", "rear")):
                lidars.publish(drive.sweep(index, frame_id=frame), lidar=number)
            lidars.wait_for_sweeps(index + 1)
            tf2.found["body", "rear", 0] = -1.0
        alone, both = (sweep.source.message for sweep in lidars.sweeps)
        assert lidars.events == ["clouds_of_lidar_2_without_transform"]
        assert (alone.width, both.width) == (1200, 2400)
        assert both.header.frame_id == "body"
        front, rear = xyz_columns(both)[:1200], xyz_columns(both)[1200:]
        ahead = np.broadcast_to([2.0, 0, 0], front.shape)
        np.testing.assert_allclose(front - rear, ahead, atol=1e-5)

    @pytest.fixture
    def two(self, make):
        """With places by parameters; the one behind looks back, and sends 20 ms later."""
        parameters = {"lidar_1.x_m": 1.5, "lidar_2.x_m": -1.5, "lidar_2.yaw_deg": 180.0}
        return make(
            lidars__count=2, lidars__poses="parameters", lidars__max_wait_s=1.0, **parameters
        )

    @staticmethod
    def send(two, drive, index, *, lidars=(0, 1), ahead_s=0):
        phases = (0, 0.2 + 10 * ahead_s)
        for lidar in lidars:
            two.publish(drive.sweep(index + phases[lidar]), lidar=lidar)
        two.wait_for_sweeps(len(two.sweeps) + 1)

    def test_keep_all_fields_and_their_own_times(self, two, drive):
        self.send(two, drive, 0)
        merged = two.sweeps[0].source.message
        assert merged.header.frame_id == "base_link"
        assert [field.name for field in merged.fields] == [*("x", "y", "z", "intensity"), *ADDED]
        lidar = column(merged, "lidar").astype(int) - 1
        np.testing.assert_allclose(column(merged, "time"), lidar * 0.02, atol=1e-6)
        own = xyz_columns(drive.sweep(0.2)) * [-1, -1, 1] + [-1.5, 0, 0]
        np.testing.assert_allclose(xyz_columns(merged)[lidar == 1], own, atol=1e-5)
        own = xyz_columns(drive.sweep(0)) + np.array([1.5, 0, 0])
        np.testing.assert_allclose(xyz_columns(merged)[lidar == 0], own, atol=1e-5)

    def test_one_that_fails_is_named_and_stops_nobody(self, two, drive):
        self.send(two, drive, 0)
        assert two.input.state.missing == ()
        for index in (1, 2):
            self.send(two, drive, index, lidars=(0,))
            assert two.input.state.missing == ("/input/points_2",)
        assert two.events == 2 * ["clouds_of_lidar_2_missing"]
        # Nobody waited for it, until it has sent something.
        for index in (3, 4):
            self.send(two, drive, index)
        assert two.input.state.missing == ()

    def test_one_with_another_clock_is_named(self, two, drive):
        self.send(two, drive, 0)
        for index in range(1, 4):
            self.send(two, drive, index, ahead_s=3600)
        (missing,) = two.input.state.missing
        assert re.fullmatch(r"/input/points_2 \(its stamps are 3\d{3}\.\d s ahead\)", missing)
        assert "clouds_of_lidar_2_of_another_time" in two.events


def test_the_pose_is_broadcast_for_the_frame_of_the_robot(tf2):
    frame = OdometryFrame(None, "odom", "base")
    known = over_ground(world_from_sensor=pose(3.0, 1.0))
    tf2.found["lidar", "base", 0] = -1.0
    header = Header(frame_id="lidar")
    header.stamp.sec = 7
    frame.publish(header, known, Transforms(None, "tf.base_frame"))
    (sent,) = tf2.sent
    assert (sent.header.frame_id, sent.child_frame_id, sent.header.stamp.sec) == ("odom", "base", 7)
    np.testing.assert_allclose(transform_matrix(sent.transform), pose(2.0, 1.0), atol=1e-12)


@pytest.mark.skipif(HAS_TF2, reason="tf2_ros is installed")
class TestWithoutTf2:
    def test_the_start_fails_and_says_what_to_install(self, start_node):
        process = start_node({"tf.broadcast": "true"})
        assert process.wait() == 2
        assert "tf.broadcast needs the Python package tf2_ros" in process.fatal
        assert "apt install" in process.fatal

    @pytest.mark.parametrize(
        "changes",
        [
            {"ego_motion.source": "tf"},
            {"ego_motion.source": "odometry", "ego_motion.sensor_pose": "tf"},
        ],
        ids=lambda changes: next(reversed(changes)),
    )
    def test_a_change_while_it_runs_is_refused(self, peer, changes):
        result = peer.set_atomically(changes)
        assert not result.successful
        assert next(reversed(changes)) in result.reason
        assert "tf2_ros" in result.reason
        assert peer.get("ego_motion.source") == "registration"


def transform(parent, child, matrix, stamp_ns=0):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = matrix[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
    return message


@pytest.mark.skipif(not HAS_TF2, reason="tf2_ros is not installed")
def test_with_the_real_tf2_ego_motion_is_looked_up_though_transforms_come_late(run_node):
    import tf2_ros

    street, start_ns = BoxStreet(), 700_000 * 10**9
    mount, origin = pose(1.2, 0.1, 1.5, yaw_deg=30), pose(40, -10, 0, yaw_deg=70)

    def base_pose(index):
        return origin @ pose(0.6 * index, yaw_deg=1.0 * index)

    parameters = {"ground.remove": "true", "ego_motion.source": "tf", "tf.timeout_s": 1.0}
    peer = run_node(QUICK | parameters, name="/tf")
    peer.wait_for_node()
    heard = {}
    peer.node.create_subscription(
        Odometry, "/tf/ego_motion", lambda message: heard.update({stamp_of(message): message}), 50
    )
    send = tf2_ros.TransformBroadcaster(peer.node).sendTransform
    peer.spin_until(lambda: peer.node.count_subscribers("/tf_static"), "the node to listen")
    tf2_ros.StaticTransformBroadcaster(peer.node).sendTransform(transform("base", "lidar", mount))
    stamps_ns = [start_ns + index * INTERVAL_NS for index in range(5)]
    for index, stamp_ns in enumerate(stamps_ns):
        lidar_pose = np.linalg.inv(origin) @ base_pose(index) @ mount
        peer.publish(xyz_message(street.xyz(lidar_pose, seed=index), stamp_ns=stamp_ns))
        # The transform of a sweep comes after it: the sweep waits.
        peer.spin_for(0.05)
        send(transform("odom", "base", base_pose(index), stamp_ns))
        if index >= 2:
            peer.spin_until(lambda at=stamps_ns[index - 1]: at in peer.flows, "the flow")
    peer.wait_until_settled()
    assert peer.count("transforms_missing") == 0
    assert peer.values("ego motion")["source"] == "tf"
    assert peer.status("ego motion").level == DiagnosticStatus.OK
    poses = [pose_matrix(heard[stamps_ns[index]].pose.pose) for index in (1, 3)]
    wanted = [base_pose(index) @ mount for index in (1, 3)]
    # Registration is centimetres off here; TF is not.
    motion, expected = (np.linalg.inv(first) @ second for first, second in (poses, wanted))
    np.testing.assert_allclose(motion, expected, atol=1e-4)
