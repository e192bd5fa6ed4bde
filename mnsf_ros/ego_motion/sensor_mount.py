"""Where the sensor is on the robot whose poses an odometry tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mnsf_ros.settings import EgoMotionSettings


def robot_from_sensor(settings: EgoMotionSettings) -> NDArray[np.float64]:
    """The pose of the sensor, (4, 4), in the moving frame of the odometry, as the settings say."""
    pose = np.eye(4)
    angles_deg = (settings.sensor_yaw_deg, settings.sensor_pitch_deg, settings.sensor_roll_deg)
    pose[:3, :3] = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix()
    pose[:3, 3] = settings.sensor_x_m, settings.sensor_y_m, settings.sensor_z_m
    return pose
