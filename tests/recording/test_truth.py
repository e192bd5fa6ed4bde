# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import tiny_bags
from bag_messages import cloud_message

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from msg_utils.point_cloud2 import encode_columns

TOPIC = "/truth/flow"


def truth_of(index, num_points=50):
    rng = np.random.default_rng(100 + index)
    valid = rng.uniform(size=num_points) < 0.8
    flow = rng.normal(size=(num_points, 3)).astype(np.float32)
    flow[~valid] = np.nan
    dynamic, ground = rng.uniform(size=(2, num_points)) < 0.5
    class_id = rng.integers(0, 10, num_points).astype(np.uint8)
    return FlowTruth(tiny_bags.stamp(index), flow, valid, dynamic, ground, class_id)


def assert_same(one, other):
    assert one.stamp_ns == other.stamp_ns
    for name in ("flow", "valid", "dynamic", "ground", "class_id"):
        a, b = getattr(one, name), getattr(other, name)
        assert a.dtype == b.dtype, name
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name


def test_object_ids_come_back_where_they_are_known():
    truth = replace(truth_of(0), object_id=np.arange(50, dtype=np.uint32) * 80_000_000)
    cloud = truth.encode(tiny_bags.xyz(0))
    found = FlowTruth.decode(cloud_message(cloud, truth.stamp_ns, "lidar", is_dense=False))
    assert found.object_id.dtype == np.uint32
    assert np.array_equal(found.object_id, truth.object_id)
    some = np.array([3, 1])
    assert np.array_equal(found.of_points(some).object_id, truth.object_id[some])
    assert truth_of(0).of_points(some).object_id is None


def test_flow_of_rows_that_are_not_valid_is_nan():
    truth = truth_of(0)
    noisy = replace(truth, flow=np.where(truth.valid[:, None], truth.flow, np.float32(3.0)))
    cloud = noisy.encode(tiny_bags.xyz(0))
    message = cloud_message(cloud, truth.stamp_ns, "lidar", is_dense=False)
    assert_same(FlowTruth.decode(message), truth)


def test_rows_must_match_the_sweep():
    with pytest.raises(RecordingError, match="truth has 50 rows for a sweep of 49 points"):
        truth_of(0).encode(tiny_bags.xyz(0)[:49])


@pytest.mark.parametrize(
    ("changes", "point_step", "text"),
    [
        ({"object_id": np.full(3, np.nan, np.float32)}, None, "object_id is of float32, expected"),
        ({"flow_x": np.full(3, np.nan, np.float32)}, None, "row 0 is valid but its flow is"),
        ({}, 7, "truth cloud cannot be decoded"),
    ],
)
def test_cloud_that_is_no_truth_is_refused(changes, point_step, text):
    columns = {name: np.ones(3, np.float32) for name in ("flow_x", "flow_y", "flow_z")}
    columns |= dict.fromkeys(("valid", "dynamic", "ground", "class_id"), np.ones(3, np.uint8))
    encoded = encode_columns(columns | changes, 1, 3)
    message = cloud_message(encoded, 5, "lidar", is_dense=False)
    message.point_step = point_step or message.point_step
    with pytest.raises(RecordingError, match=text):
        FlowTruth.decode(message)


def test_pose_that_is_no_rigid_motion_is_not_written(tmp_path):
    with (
        pytest.raises(RecordingError, match="pose is no rigid motion"),
        BagWriter(tmp_path / "bag") as writer,
    ):
        writer.write_odometry("/odom", np.zeros((4, 4)), 5, "odom", "lidar")
    assert not list(tmp_path.iterdir())
