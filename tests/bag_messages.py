# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages as a recording gives them."""

from types import SimpleNamespace

from mnsf_ros.recording.bag_topics import jazzy
from msg_utils.cdr import serialized_cloud
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.stamps import encode_stamp


def cloud_cdr(cloud, stamp_ns, frame_id="lidar", *, is_dense=True):
    """CDR bytes of an encoded cloud."""
    sec, nanosec = encode_stamp(stamp_ns)
    stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
    header = SimpleNamespace(stamp=stamp, frame_id=frame_id)
    return serialized_cloud(header, cloud, is_dense=is_dense)


def cloud_message(cloud, stamp_ns, frame_id="lidar", *, is_dense=True):
    """A sensor_msgs/PointCloud2 of an encoded cloud; its data may be changed."""
    raw = cloud_cdr(cloud, stamp_ns, frame_id, is_dense=is_dense)
    message = jazzy().deserialize_cdr(raw, CLOUD_TYPE)
    message.data = message.data.copy()
    return message
