# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Online lidar scene flow for ROS 2: the motion of every point, without training or labels."""

__version__ = "0.1.0"
