# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Conversion of arrays to ROS messages, in the types of the bag library."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy as ros

from mnsf_ros.geometry.transforms import pose_quaternion
from msg_utils.cloud_layout import EncodedCloud
from msg_utils.stamps import encode_stamp


def cloud_message(
    cloud: EncodedCloud, stamp_ns: int, frame_id: str, *, is_dense: bool
) -> ros.sensor_msgs__msg__PointCloud2:
    """Returns a sensor_msgs/PointCloud2.

    Raises:
        MessageError: The stamp does not fit a ROS message.
    """
    return ros.sensor_msgs__msg__PointCloud2(
        header=_header(stamp_ns, frame_id),
        height=cloud.height,
        width=cloud.width,
        fields=[
            ros.sensor_msgs__msg__PointField(
                name=field.name, offset=field.offset, datatype=field.datatype, count=field.count
            )
            for field in cloud.fields
        ],
        is_bigendian=cloud.is_bigendian,
        point_step=cloud.point_step,
        row_step=cloud.row_step,
        data=cloud.data,
        is_dense=is_dense,
    )


def odometry_message(
    pose: NDArray[np.floating[Any]], stamp_ns: int, frame_id: str, child_frame_id: str
) -> ros.nav_msgs__msg__Odometry:
    """Returns a nav_msgs/Odometry of the (4, 4) pose of the child frame, without velocity.

    Raises:
        MessageError: The stamp does not fit a ROS message, or the pose is no rigid motion.
    """
    x, y, z = (float(value) for value in pose[:3, 3])
    qx, qy, qz, qw = pose_quaternion(pose)
    still = ros.geometry_msgs__msg__Vector3(x=0.0, y=0.0, z=0.0)
    return ros.nav_msgs__msg__Odometry(
        header=_header(stamp_ns, frame_id),
        child_frame_id=child_frame_id,
        pose=ros.geometry_msgs__msg__PoseWithCovariance(
            pose=ros.geometry_msgs__msg__Pose(
                position=ros.geometry_msgs__msg__Point(x=x, y=y, z=z),
                orientation=ros.geometry_msgs__msg__Quaternion(x=qx, y=qy, z=qz, w=qw),
            ),
            covariance=np.zeros(36),
        ),
        twist=ros.geometry_msgs__msg__TwistWithCovariance(
            twist=ros.geometry_msgs__msg__Twist(linear=still, angular=still),
            covariance=np.zeros(36),
        ),
    )


def _header(stamp_ns: int, frame_id: str) -> ros.std_msgs__msg__Header:
    stamp = encode_stamp(stamp_ns)
    return ros.std_msgs__msg__Header(
        stamp=ros.builtin_interfaces__msg__Time(sec=stamp.sec, nanosec=stamp.nanosec),
        frame_id=frame_id,
    )
