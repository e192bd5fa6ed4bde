# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Estimates of levelled sweeps in the frame of the sensor again."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, TrackedObject
from mnsf_ros.core.reason import Match, Reason
from mnsf_ros.ego_motion.covariance import chained_covariance, six_axes
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.geometry.transforms import apply, turned_yaw
from mnsf_ros.sweeps.mounting import Mounting
from mnsf_ros.sweeps.sweep import Sweep

Known = TypeVar("Known")
Item = TypeVar("Item")
_NO_STEP = np.zeros((6, 6))


def in_sensor_frame(estimate: FlowEstimate, current: Sweep) -> FlowEstimate:
    """Returns the estimate of a levelled sweep in the frame of `current`, the sweep itself."""
    mounting = current.tilt
    if mounting is None:
        return estimate
    back = mounting.sensor_from_level
    return replace(
        estimate,
        flow=turned(estimate.flow, back[:3, :3]),
        over_ground=_if_known(estimate.over_ground, lambda known: _over_ground(known, mounting)),
        reason_of=_if_known(
            estimate.reason_of, lambda find: lambda rows: _reason(find(rows), back)
        ),
    )


def _over_ground(known: OverGround, mounting: Mounting) -> OverGround:
    back, level = mounting.sensor_from_level, mounting.level_from_sensor

    def covariance(own: Floats, pose: Floats) -> Floats:
        """Of a levelled pose, for the origin of the sensor's frame."""
        return _turned_axes(chained_covariance(own, pose, level, _NO_STEP), back)

    pose, motion = known.world_from_sensor, known.next_from_current
    step = np.asarray(np.linalg.inv(motion), np.float64)
    return replace(
        known,
        motion=turned(known.motion, back[:3, :3]),
        world_from_sensor=back @ pose @ level,
        next_from_current=back @ motion @ level,
        pose_covariance=_if_known(known.pose_covariance, lambda own: covariance(own, pose)),
        motion_covariance=_if_known(known.motion_covariance, lambda own: covariance(own, step)),
        objects=tuple(_object(item, back) for item in known.objects),
    )


def _object(item: TrackedObject, back: Floats) -> TrackedObject:
    """The object in the frame of the sensor; its size stays that of the upright box."""
    turn = back[:3, :3]
    return replace(
        item,
        center=apply(back, item.center[None])[0],
        yaw=turned_yaw(turn, item.yaw),
        velocity=turn @ item.velocity,
        turn_rate=float(item.turn_rate * turn[2, 2]),
        covariance=_turned_axes(item.covariance, back),
    )


def _reason(reason: Reason, back: Floats) -> Reason:
    def matched(match: Match) -> Match:
        return replace(match, positions=transformed(match.positions, back))

    return replace(
        reason,
        sweeps=[
            replace(
                terms,
                points=transformed(terms.points, back),
                static=matched(terms.static),
                moving=_if_known(terms.moving, matched),
            )
            for terms in reason.sweeps
        ],
        start=_if_known(reason.start, lambda start: back[:3, :3] @ start),
        motion=_if_known(reason.motion, lambda motion: back[:3, :3] @ motion),
    )


def _turned_axes(covariance: Floats, back: Floats) -> Floats:
    """A covariance (6, 6) of two vectors, in the turned axes."""
    axes = six_axes(back[:3, :3])
    return np.asarray(axes @ covariance @ axes.T)


def _if_known(item: Item | None, change: Callable[[Item], Known]) -> Known | None:
    return None if item is None else change(item)
