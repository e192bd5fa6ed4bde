# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages without ROS: defaults, and what is refused."""

import pytest

from mnsf_ros.recording.bag_topics import jazzy
from mnsf_ros.recording.messages import Messages

# With arrays, sequences, text and nested messages.
TYPES = ("sensor_msgs/CameraInfo", "visualization_msgs/Marker", "rcl_interfaces/ParameterValue")


@pytest.mark.parametrize("name", TYPES)
def test_all_fields_have_defaults_that_can_be_written(name):
    package, message = name.split("/")
    made = getattr(Messages(package), message)()
    raw = jazzy().serialize_cdr(made, made.__msgtype__)
    assert len(raw) > 0
    assert (
        jazzy().serialize_cdr(jazzy().deserialize_cdr(raw, made.__msgtype__), made.__msgtype__)
        == raw
    )


def test_fields_that_are_given():
    header = Messages("std_msgs").Header(frame_id="lidar")
    assert (header.frame_id, header.stamp.sec) == ("lidar", 0)
    assert Messages("visualization_msgs").Marker.CUBE == 1
    first, second = (Messages("std_msgs").Header() for _ in range(2))
    first.stamp.sec = 3
    assert second.stamp.sec == 0


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="std_msgs has no message Heading"):
        Messages("std_msgs").Heading  # noqa: B018
    with pytest.raises(TypeError, match="std_msgs/msg/Header has no field frame"):
        Messages("std_msgs").Header(frame="lidar")
