# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording in, a recording with its flow out."""

import numpy as np
import pytest

from mnsf_ros.cli.evaluate import EXIT_INCOMPLETE
from mnsf_ros.cli.main import run
from mnsf_ros.geometry.transforms import invert, pose_matrix, transform_matrix
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from msg_utils.point_cloud2 import decode_points, encode_columns

NODE = "/scene_flow"
TOPICS = (
    *("flow", "flow/moving", "objects", "objects/markers", "predicted"),
    *("ego_motion", "ego_motion/source"),
)


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    path = tmp_path_factory.mktemp("street") / "street"
    assert run(["simulate", str(path), "--num-beams", "16", "--duration-s", "0.8"]) == 0
    return path


def test_holds_what_the_node_would_publish(street, tmp_path):
    out = tmp_path / "flow.mcap"
    assert run(["estimate", str(street), "--out", str(out)]) == 0
    stream, settings = Stream(Settings()), Settings().time
    with BagReader(street) as reader:
        clouds = CloudReader()
        sweeps = [clouds.sweep(one, settings, 0) for one in reader.messages("/points")]
    wanted = {}
    for sweep in sweeps:
        if (estimate := stream.push(sweep)) is not None:
            wanted[stream.triplet.current.stamp_ns] = estimate
    with BagReader(out) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            f"{NODE}/{name}": len(sweeps) - 2 for name in TOPICS
        }
        for (stamp_ns, _), cloud in zip(
            reader.raw_messages(f"{NODE}/flow"), reader.messages(f"{NODE}/flow"), strict=True
        ):
            columns = decode_points(cloud).ravel()
            flow = np.stack([columns[f"flow_{axis}"] for axis in "xyz"], axis=1)
            np.testing.assert_array_equal(flow, wanted[stamp_ns].flow)
        for cloud, estimate in zip(
            reader.messages(f"{NODE}/objects"), wanted.values(), strict=True
        ):
            assert cloud.width == len(estimate.over_ground.objects)
        for one, estimate in zip(
            reader.messages(f"{NODE}/ego_motion"), wanted.values(), strict=True
        ):
            known = estimate.over_ground
            assert one.pose.pose.position.x == known.world_from_sensor[0, 3]
            np.testing.assert_array_equal(one.pose.covariance, known.pose_covariance.ravel())
            # Not known to stand still.
            assert one.twist.covariance[0] > 1e3


def test_ego_motion_is_that_of_the_odometry_and_on_tf_if_asked_for(street, tmp_path):
    out, by_odometry = tmp_path / "flow.mcap", ["--set", "ego_motion.source=odometry"]
    odometry = ["--odometry", "/truth/odometry", *by_odometry, "--set", "tf.broadcast=true"]
    assert run(["estimate", str(street), "--out", str(out), *odometry]) == 0
    with BagReader(street) as reader:
        true = [pose_matrix(one.pose.pose) for one in reader.messages("/truth/odometry")]
    with BagReader(out) as reader:
        found = [pose_matrix(one.pose.pose) for one in reader.messages(f"{NODE}/ego_motion")]
        links = [one.transforms[0] for one in reader.messages("/tf")]
    assert {one.child_frame_id for one in links} == {"lidar"}
    for one, pose in zip(links, found, strict=True):
        np.testing.assert_allclose(transform_matrix(one.transform), pose, atol=1e-9)
    # From the first sweep, which has no flow.
    for before, after, now, then in zip(true[1:], true[2:], found, found[1:], strict=False):
        np.testing.assert_allclose(invert(now) @ then, invert(before) @ after, atol=1e-6)


@pytest.mark.parametrize("inside", ["", "street.mcap", "flow.mcap"])
def test_never_replaces_what_it_reads(street, inside, capsys):
    before = sorted((path.name, path.stat().st_size) for path in street.iterdir())
    assert run(["estimate", str(street), "--out", str(street / inside), "--force"]) == 2
    assert "is the recording that is read" in capsys.readouterr().err
    assert sorted((path.name, path.stat().st_size) for path in street.iterdir()) == before


def test_without_any_flow_there_is_no_recording(street, tmp_path, capsys):
    out = tmp_path / "flow"
    with BagWriter(tmp_path / "one") as writer:
        writer.write_cloud("/points", encode_columns({"x": np.zeros(1)}, 1, 1), 1, "lidar")
    assert run(["estimate", str(tmp_path / "one"), "--out", str(out)]) == 2
    assert "no sweep of /points has a flow: three sweeps in a row" in capsys.readouterr().err
    assert not out.exists()


def test_of_a_damaged_recording_the_readable_part_is_estimated(street, tmp_path, capsys):
    cut, whole = tmp_path / "cut.mcap", next(street.glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    out = tmp_path / "flow.mcap"
    assert run(["estimate", str(cut), "--out", str(out)]) == EXIT_INCOMPLETE
    assert f"{cut}, byte " in capsys.readouterr().err
    with BagReader(out) as reader:
        assert reader.topics[f"{NODE}/flow"].count > 0
