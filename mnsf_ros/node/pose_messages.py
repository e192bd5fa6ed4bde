"""The ego motion as nav_msgs/Odometry."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.geometry.pose_messages import pose_quaternion

WORLD_FRAME = "scene_flow_odom"


def ego_motion_message(header: Header, known: OverGround, interval_s: float) -> Odometry:
    """Where the sensor was at a sweep, and how it moves.

    Args:
        header: Of the sweep's cloud.
        known: What its estimate says of the sensor's motion.
        interval_s: Seconds to the next sweep; the twist is 0 where it is not positive.

    Returns:
        Pose of the sensor in `scene_flow_odom`, which is the sensor frame of the first sweep;
        twist in the sensor's own frame.
    """
    message = Odometry(child_frame_id=header.frame_id)
    message.header.stamp = header.stamp
    message.header.frame_id = WORLD_FRAME
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = known.world_from_sensor[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = pose_quaternion(known.world_from_sensor)
    if interval_s > 0:
        # The sensor moves against what stands still.
        current_from_next = np.linalg.inv(known.next_from_current)
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        linear.x, linear.y, linear.z = (current_from_next[:3, 3] / interval_s).tolist()
        rotation = Rotation.from_matrix(current_from_next[:3, :3]).as_rotvec()
        angular.x, angular.y, angular.z = (rotation / interval_s).tolist()
    return message
