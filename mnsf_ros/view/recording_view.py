# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording is played, estimated and shown, with the names of topics that the node has."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, Final

from mnsf_ros.core.flow_estimate import OverGround, TrackedObject
from mnsf_ros.demo.pace import in_time
from mnsf_ros.drawing.color_wheel import object_color
from mnsf_ros.geometry.pose_messages import pose_quaternion
from mnsf_ros.settings import OutputSettings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud
from mnsf_ros.view.estimated_sweeps import EstimatedSweep
from mnsf_ros.view.view_server import ViewServer

_ODOM_FRAME: Final = "scene_flow_odom"
_OPACITY: Final = 0.4
_LABEL_M: Final = 0.7
_CDR: Final = b"\x00\x01\x00\x00"


class RecordingView:
    """The channels of a server for the flow of a recording."""

    def __init__(self, server: ViewServer) -> None:
        """Advertises them."""
        self._flow = server.channel("/scene_flow/flow", "sensor_msgs/msg/PointCloud2")
        self._time = server.channel("/scene_flow/debug/processing_time_ms", "std_msgs/msg/Float64")
        self._objects = server.typed_channel("/scene_flow/objects/scene", "SceneUpdate")
        self._transform = server.typed_channel("/tf", "FrameTransform")

    def play(
        self,
        sweeps: Iterable[EstimatedSweep],
        rate: float,
        wait: Callable[[float], None],
        on_shown: Callable[[int], None],
    ) -> None:
        """Shows sweeps, each when it is due, or as fast as they are estimated.

        Args:
            sweeps: In the order of time.
            rate: Speed over that of the recording, above 0.
            wait: Called with the seconds to wait.
            on_shown: Called with the number of sweeps shown so far.
        """
        timed = ((sweep.triplet.current.stamp_ns, sweep) for sweep in sweeps)
        for number, (_, sweep) in enumerate(in_time(timed, wait, rate), start=1):
            self._show(sweep)
            on_shown(number)

    def _show(self, shown: EstimatedSweep) -> None:
        triplet, estimate = shown.triplet, shown.estimate
        sweep, known = triplet.current, estimate.over_ground
        stamp_ns = sweep.stamp_ns
        if known is not None:
            self._transform.log(_transform(sweep, known), log_time=stamp_ns)
            self._objects.log(_scene(sweep, known.objects), log_time=stamp_ns)
        self._time.log(_CDR + struct.pack("<d", estimate.time_ms), log_time=stamp_ns)
        cloud = flow_cloud(sweep, estimate, triplet.interval_s, OutputSettings())
        self._flow.log(cloud, log_time=stamp_ns)


def _transform(sweep: Sweep, known: OverGround) -> Any:  # noqa: ANN401 - of a library without types
    from foxglove.messages import FrameTransform, Quaternion, Vector3

    x, y, z = known.world_from_sensor[:3, 3].tolist()
    return FrameTransform(
        timestamp=_timestamp(sweep),
        parent_frame_id=_ODOM_FRAME,
        child_frame_id=sweep.frame_id,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(
            **dict(zip("xyzw", pose_quaternion(known.world_from_sensor), strict=True))
        ),
    )


def _scene(sweep: Sweep, objects: Iterable[TrackedObject]) -> Any:  # noqa: ANN401
    """Replaces the objects of the sweep before."""
    from foxglove.messages import SceneEntityDeletion, SceneEntityDeletionType, SceneUpdate

    everything = SceneEntityDeletion(
        timestamp=_timestamp(sweep), type=SceneEntityDeletionType.All, id=""
    )
    return SceneUpdate(deletions=[everything], entities=[_entity(sweep, item) for item in objects])


def _entity(sweep: Sweep, item: TrackedObject) -> Any:  # noqa: ANN401
    from foxglove.messages import (
        ArrowPrimitive,
        Color,
        CubePrimitive,
        Pose,
        Quaternion,
        SceneEntity,
        TextPrimitive,
        Vector3,
    )

    def pose(yaw: float, above_m: float = 0.0) -> Pose:
        x, y, z = item.center.tolist()
        turn = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
        return Pose(position=Vector3(x=x, y=y, z=z + above_m), orientation=turn)

    red, green, blue = object_color(item.track_id)
    length, width, height = item.size.tolist()
    vx, vy, _ = item.velocity.tolist()
    speed = math.hypot(vx, vy)
    solid = Color(r=red, g=green, b=blue, a=1.0)
    return SceneEntity(
        timestamp=_timestamp(sweep),
        frame_id=sweep.frame_id,
        id=str(item.track_id),
        cubes=[
            CubePrimitive(
                pose=pose(item.yaw),
                size=Vector3(x=length, y=width, z=height),
                color=Color(r=red, g=green, b=blue, a=_OPACITY),
            )
        ],
        arrows=[
            ArrowPrimitive(
                pose=pose(math.atan2(vy, vx)),
                shaft_length=speed,
                shaft_diameter=0.2,
                head_length=0.4,
                head_diameter=0.5,
                color=solid,
            )
        ],
        texts=[
            TextPrimitive(
                pose=pose(0.0, height / 2 + _LABEL_M),
                billboard=True,
                font_size=_LABEL_M,
                color=solid,
                text=f"{item.track_id}: {speed:.1f} m/s",
            )
        ],
    )


def _timestamp(sweep: Sweep) -> Any:  # noqa: ANN401
    from foxglove.messages import Timestamp

    return Timestamp(*divmod(sweep.stamp_ns, 10**9))
