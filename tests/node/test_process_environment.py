# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import fcntl
import itertools
import os
import shutil
import subprocess
import sys
import time
import types
from xml.etree import ElementTree

import numpy as np
import pytest
from synthetic_clouds import ADDED_BYTES, surfaces, xyz_message

from mnsf_ros.node.environment import (
    SEGMENT_BYTES,
    TRANSPORT_PROFILE,
    prepare_environment,
    remove_dead_segments,
    transport_fault,
)

_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_NEWER_PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE"
# A cloud that has not come by then is lost.
_LOST_S = 5.0


class TestPrepareEnvironment:
    def test_sets_what_is_not_set(self):
        environment = {"HOME": "/root"}
        prepare_environment(environment)
        assert environment == {
            "HOME": "/root",
            _PROFILE: str(TRANSPORT_PROFILE),
            "RMW_FASTRTPS_USE_QOS_FROM_XML": "1",
            "OMP_WAIT_POLICY": "PASSIVE",
        }

    @pytest.mark.parametrize("variable", [_PROFILE, _NEWER_PROFILE])
    def test_leaves_a_profile_of_the_user_alone(self, variable):
        environment = {variable: "/my/profile.xml", "OMP_WAIT_POLICY": "ACTIVE"}
        prepare_environment(environment)
        assert environment == {variable: "/my/profile.xml", "OMP_WAIT_POLICY": "ACTIVE"}

    def test_takes_an_empty_profile_for_none(self):
        environment = {_PROFILE: "", _NEWER_PROFILE: ""}
        prepare_environment(environment)
        assert environment[_PROFILE] == str(TRANSPORT_PROFILE)

    def test_the_profile_has_room_for_large_clouds_and_fits_into_a_container(self):
        names = {"dds": "http://www.eprosima.com"}
        root = ElementTree.parse(TRANSPORT_PROFILE).getroot()
        (segment,) = root.findall(".//dds:segment_size", names)
        assert 2 * 4_000_000 < int(segment.text) <= 32 * 2**20
        assert int(segment.text) == SEGMENT_BYTES


class TestTransportFault:
    OURS = types.MappingProxyType({_PROFILE: str(TRANSPORT_PROFILE)})

    def test_is_none_where_there_is_shared_memory(self, tmp_path):
        assert transport_fault(self.OURS, tmp_path) == ""

    def test_says_what_is_wrong_and_what_follows(self, tmp_path):
        fault = transport_fault(self.OURS, tmp_path / "gone")
        assert fault.startswith(f"no shared memory, {tmp_path / 'gone'}: No such file or directory")
        assert "clouds go through UDP, which loses large ones of best-effort" in fault
        assert "Publish reliable" in fault
        assert "\n" not in fault

    def test_is_also_too_little_room(self, tmp_path, monkeypatch):
        usage = shutil.disk_usage(tmp_path)._replace(free=8 << 20)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
        assert "8 MiB left, 24 are needed" in transport_fault(self.OURS, tmp_path)

    @pytest.mark.parametrize(
        "environment",
        [
            {},
            {_PROFILE: "/my/profile.xml"},
            {_PROFILE: str(TRANSPORT_PROFILE), "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        ],
    )
    def test_is_not_looked_for_in_transports_of_others(self, environment, tmp_path):
        assert transport_fault(environment, tmp_path / "gone") == ""


def large_sweep(index, drive):
    """2 MB: 120,000 points of 16 bytes, most of them ground far below the boxes."""
    ground = np.random.default_rng(1).uniform(-60, 60, (118_800, 3))
    ground[:, 2] = -50
    xyz = np.vstack([surfaces(index), ground]).astype(np.float32)
    return xyz_message(xyz, stamp_ns=drive.stamp_ns(index))


class TestLargeClouds:
    @pytest.fixture
    def peer(self, resting_peer):
        resting_peer.advertise(reliable=False)
        resting_peer.wait_for_node()
        return resting_peer

    def test_of_a_best_effort_publisher_with_the_profile_arrive(self, peer, drive):
        num_sent, before = 20, peer.count("sweeps_received")
        for index in range(num_sent):
            received = peer.count("sweeps_received")
            peer.publish(large_sweep(index, drive))
            # As fast as the node takes them, however slow the machine is.
            give_up = time.monotonic() + _LOST_S
            while peer.count("sweeps_received") == received and time.monotonic() < give_up:
                peer.spin_for(0.02)
        # The default transport loses most of them.
        assert peer.count("sweeps_received") - before >= 0.7 * num_sent

    def test_with_flow_arrive_at_a_best_effort_subscriber(self, peer, drive):
        before = peer.count("flows_out")
        peer.flows.clear()
        peer.watch(reliable=False)
        indices = itertools.count()

        def have_come():
            peer.publish(large_sweep(next(indices), drive))
            peer.spin_for(0.2)
            return len(peer.flows) >= 3

        peer.spin_until(have_come, "three clouds with flow")
        assert len(peer.flows) >= 0.5 * (peer.count("flows_out") - before)
        assert {len(flow.data) for flow in peer.flows.values()} == {120_000 * (16 + ADDED_BYTES)}


def test_only_segments_of_killed_processes_are_removed(tmp_path):
    """As Fast DDS lays them out: the process of a segment holds a file locked."""

    def segment(number, age_s=3600.0, name="fastrtps_{:016x}"):
        file = tmp_path / name.format(number)
        lock = file.with_name(f"{file.name}_el")
        file.write_bytes(bytes(1000))
        lock.touch()
        os.utime(lock, (time.time() - age_s,) * 2)
        return file, lock

    dead, living, young = segment(10), segment(11), segment(12, age_s=1)
    others = (*segment(7411, name="fastrtps_port{}"), *segment(1, name="other_{}"))
    alone = tmp_path / f"fastrtps_{13:016x}_el"
    alone.touch()
    os.utime(alone, (0, 0))
    with living[1].open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert remove_dead_segments(tmp_path) == 1000
        assert remove_dead_segments(tmp_path) == 0
    assert set(tmp_path.iterdir()) == {*living, *young, *others}
    assert not dead[0].exists()
    assert remove_dead_segments(tmp_path / "gone") == 0


# What the process has mapped when a node was refused, and when it had none at all.
_REFUSED = """
import sys
sys.modules["torch"] = None
from mnsf_ros.node.environment import prepare_environment
prepare_environment()
import rclpy
from mnsf_ros.errors import SettingsError
from mnsf_ros.node.scene_flow_node import SceneFlowNode

def mapped():
    maps = open("/proc/self/maps").read().split()
    return sum(word.startswith("/dev/shm/fast") and "_port" not in word for word in maps)

rclpy.init(args=["--ros-args", "-p", "method.name:=mnsf"])
try:
    SceneFlowNode()
except SettingsError as error:
    print("torch" in str(error), mapped())
node = rclpy.create_node("another")
print(mapped())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_a_refused_node_leaves_no_shared_memory(ros):
    # Segments of other nodes, which it would map, too, are not its own.
    alone = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    command = [sys.executable, "-c", _REFUSED]
    result = subprocess.run(command, env=alone, capture_output=True, text=True, check=True)
    is_named, left, with_node = result.stdout.split()
    assert (is_named, left) == ("True", "0")
    assert int(with_node) > 0
