# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Definitions of messages of other packages, as published, without their comments."""

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mnsf_ros.recording.messages import Messages

# github.com/autowarefoundation/autoware_msgs, autoware_perception_msgs 1.12, commit 7025d8f7.
AUTOWARE = {
    "ObjectClassification": """
uint8 UNKNOWN = 0
uint8 CAR = 1
uint8 TRUCK = 2
uint8 BUS = 3
uint8 TRAILER = 4
uint8 MOTORCYCLE = 5
uint8 BICYCLE = 6
uint8 PEDESTRIAN = 7
uint8 ANIMAL = 8
uint8 HAZARD = 9
uint8 OVER_DRIVABLE = 10
uint8 UNDER_DRIVABLE = 11
uint8 label
float32 probability
""",
    "Shape": """
uint8 BOUNDING_BOX=0
uint8 CYLINDER=1
uint8 POLYGON=2
uint8 type
geometry_msgs/Polygon footprint
geometry_msgs/Vector3 dimensions
""",
    "TrackedObjectKinematics": """
uint8 UNAVAILABLE=0
uint8 SIGN_UNKNOWN=1
uint8 AVAILABLE=2
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
""",
    "TrackedObject": """
unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
TrackedObjectKinematics kinematics
Shape shape
""",
    "TrackedObjects": """
std_msgs/Header header
TrackedObject[] objects
""",
    "DetectedObjectKinematics": """
uint8 UNAVAILABLE=0
uint8 SIGN_UNKNOWN=1
uint8 AVAILABLE=2
geometry_msgs/PoseWithCovariance pose_with_covariance
bool has_position_covariance
uint8 orientation_availability
geometry_msgs/TwistWithCovariance twist_with_covariance
bool has_twist
bool has_twist_covariance
""",
    "DetectedObject": """
float32 existence_probability
ObjectClassification[] classification
DetectedObjectKinematics kinematics
Shape shape
""",
    "DetectedObjects": """
std_msgs/Header header
DetectedObject[] objects
""",
}
# github.com/ros-perception/vision_msgs, branch ros2, commit e77fa2d9.
VISION = {
    "ObjectHypothesis": """
string class_id
float64 score
""",
    "ObjectHypothesisWithPose": """
ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
""",
    "BoundingBox3D": """
geometry_msgs/Pose center
geometry_msgs/Vector3 size
""",
    "Detection3D": """
std_msgs/Header header
ObjectHypothesisWithPose[] results
BoundingBox3D bbox
string id
""",
    "Detection3DArray": """
std_msgs/Header header
Detection3D[] detections
""",
}
# github.com/ros-navigation/navigation2_dynamic, nav2_dynamic_msgs, commit e1b0d920.
NAV2 = {
    "Obstacle": """
unique_identifier_msgs/UUID uuid
float32 score
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 size
float64[9] position_covariance
float64[9] velocity_covariance
""",
    "ObstacleArray": """
std_msgs/Header header
Obstacle[] obstacles
""",
}


class Package:
    """A package of messages, by their definitions.

    Attributes:
        messages: Stands for its Python module.
    """

    def __init__(self, name, definitions):
        self._name, self._store = name, get_typestore(Stores.ROS2_JAZZY)
        for message, text in definitions.items():
            self._store.register(get_types_from_msg(text, f"{name}/msg/{message}"))
        self.messages = Messages(name, self._store)

    def sent(self, message):
        """A message as its receiver has it."""
        msgtype = message.__msgtype__
        return self._store.deserialize_cdr(self._store.serialize_cdr(message, msgtype), msgtype)
