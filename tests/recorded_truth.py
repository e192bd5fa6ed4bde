# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""True flow and sensor poses of an open recording, by stamp."""

from mnsf_ros.geometry.transforms import pose_matrix
from mnsf_ros.recording.flow_truth import FlowTruth
from msg_utils.stamps import decode_stamp


def read_truth(reader):
    """Stamp of a sweep to its true flow, in their order."""
    found = [FlowTruth.decode(message) for message in reader.messages("/truth/flow")]
    return {truth.stamp_ns: truth for truth in sorted(found, key=lambda one: one.stamp_ns)}


def read_sensor_poses(reader):
    """Stamp to world_from_sensor (4, 4), in the order of recording."""
    return {
        decode_stamp(message.header.stamp): pose_matrix(message.pose.pose)
        for message in reader.messages("/truth/odometry")
    }
