"""Topics, types and frames of a recording with truth; `docs/recordings.md` explains them."""

from __future__ import annotations

from typing import Final

POINTS_TOPIC: Final = "/points"
TRUTH_FLOW_TOPIC: Final = "/truth/flow"
TRUTH_ODOMETRY_TOPIC: Final = "/truth/odometry"

CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE: Final = "nav_msgs/msg/Odometry"

LIDAR_FRAME: Final = "lidar"
ODOMETRY_FRAME: Final = "odom"
