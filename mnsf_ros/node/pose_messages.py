"""nav_msgs/Odometry <-> pose matrices."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import OverGround
from msg_utils.errors import MessageError

WORLD_FRAME = "scene_flow_odom"
_MIN_NORM, _MAX_NORM = 0.5, 1.5
_FARTHEST_M = 1e9  # the difference of two such positions is good to a micrometre


def pose_from_message(message: Odometry) -> NDArray[np.float64]:
    """The pose of an odometry message, (4, 4) world_from_robot.

    Raises:
        MessageError: If a number is not finite or beyond all distances on Earth, or the
            quaternion is none.
    """
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    shift = np.array([position.x, position.y, position.z])
    norm = float(np.linalg.norm(quaternion))
    if not (_MIN_NORM < norm < _MAX_NORM) or not (np.abs(shift) < _FARTHEST_M).all():
        raise MessageError(
            f"odometry: got position {shift.tolist()} and orientation {quaternion.tolist()}, "
            f"expected metres below {_FARTHEST_M:g} and a unit quaternion"
        )
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    pose[:3, 3] = shift
    return pose


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
    turn.x, turn.y, turn.z, turn.w = (
        Rotation.from_matrix(known.world_from_sensor[:3, :3]).as_quat().tolist()
    )
    if interval_s > 0:
        # The sensor moves against what stands still.
        current_from_next = np.linalg.inv(known.next_from_current)
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        linear.x, linear.y, linear.z = (current_from_next[:3, 3] / interval_s).tolist()
        rotation = Rotation.from_matrix(current_from_next[:3, :3]).as_rotvec()
        angular.x, angular.y, angular.z = (rotation / interval_s).tolist()
    return message
