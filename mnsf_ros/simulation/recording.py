# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recordings of simulated sweeps; with the topics of a robot with nav2 if asked for."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.bag_topics import (
    IMU_TOPIC,
    LIDAR_FRAME,
    ODOMETRY_FRAME,
    TRUTH_OBJECTS_TOPIC,
)
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.simulation.bodies import Body
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import FIRST_STAMP_NS, SweepSimulator
from mnsf_ros.sweeps.sweep import NANOSECONDS

_ROBOT_FRAME = "base_link"
_ODOMETRY_TOPIC = "/odom"
_POSES_PER_SWEEP = 5
_STEP_S = 0.01  # between two poses whose difference is a velocity


def write_recording(
    settings: SimulationSettings,
    path: Path | str,
    progress: Callable[[int, int], None] | None = None,
    *,
    overwrite: bool = False,
    nav2: bool = False,
) -> SweepSimulator:
    """Simulates and writes a recording; returns its simulator.

    `progress` gets the number of sweeps done and in all. With `nav2` the recording also has `/tf`,
    `/odom` and the exact tracks of all bodies that can move.

    Raises:
        RecordingError: The recording cannot be written.
    """
    simulator = SweepSimulator(settings)
    rates = simulator.turn_rates(settings.imu_hz)
    times_s = simulator.times_s[: simulator.num_sweeps]
    parts = np.split(rates, np.searchsorted(rates[:, 0], times_s))
    with BagWriter(path, overwrite=overwrite) as writer:
        for number, (sweep, before) in enumerate(zip(simulator, parts, strict=False), start=1):
            _write_turn_rates(writer, before)
            # The last sweep has no next sweep in which its points could be found.
            valid = sweep.truth.valid & (number < simulator.num_sweeps)
            true = replace(sweep, truth=replace(sweep.truth, valid=valid))
            writer.write_sweep(true, LIDAR_FRAME)
            if nav2:
                stamp_ns, object_ids = sweep.truth.stamp_ns, sweep.truth.object_id
                tracks = _exact_tracks(simulator, number - 1, object_ids)
                writer.write_objects(TRUTH_OBJECTS_TOPIC, tracks, stamp_ns, LIDAR_FRAME)
                _write_robot(writer, simulator, number - 1, stamp_ns)
            if progress is not None:
                progress(number, simulator.num_sweeps)
        _write_turn_rates(writer, parts[-1])
    return simulator


def _write_turn_rates(writer: BagWriter, rates: Floats) -> None:
    for time_s, *rate in rates.tolist():
        stamp_ns = FIRST_STAMP_NS + round(time_s * NANOSECONDS)
        writer.write_turn_rate(IMU_TOPIC, rate, stamp_ns, LIDAR_FRAME)


def _write_robot(writer: BagWriter, simulator: SweepSimulator, number: int, stamp_ns: int) -> None:
    """Adds `/tf` and `/odom` from a sweep to the next one; the robot is under the lidar."""
    ego, (start_s, end_s) = simulator.scene.ego, simulator.times_s[number : number + 2].tolist()
    for time_s in np.linspace(start_s, end_s, _POSES_PER_SWEEP, endpoint=False).tolist():
        now_ns, robot = stamp_ns + round((time_s - start_s) * NANOSECONDS), ego.trip.pose(time_s)
        lidar = invert(robot) @ ego.world_from_sensor(time_s)
        links = {(ODOMETRY_FRAME, _ROBOT_FRAME): robot, (_ROBOT_FRAME, LIDAR_FRAME): lidar}
        writer.write_transforms(now_ns, links)
        velocity = _velocity(robot, ego.trip.pose(time_s + _STEP_S))
        frames = ODOMETRY_FRAME, _ROBOT_FRAME
        writer.write_odometry(_ODOMETRY_TOPIC, robot, now_ns, *frames, velocity=velocity)


def _exact_tracks(
    simulator: SweepSimulator, number: int, object_ids: NDArray[np.uint32] | None
) -> list[TrackedObject]:
    """Returns the tracks of all bodies that can move within the range of the lidar, also hidden.

    `object_ids` (N,) of the points of the sweep are the numbers of the tracks.
    """
    scene, time_s = simulator.scene, float(simulator.times_s[number])
    counts = np.bincount([] if object_ids is None else object_ids, minlength=len(scene.bodies) + 1)
    lidar_from_world = invert(scene.ego.world_from_sensor(time_s))
    tracks = [
        _track(body, track_id, time_s, lidar_from_world, int(counts[track_id]))
        for track_id, body in enumerate(scene.bodies, start=1)
        if body.trip is not None
    ]
    return [one for one in tracks if np.linalg.norm(one.center) < scene.sensor.max_range_m]


def _track(
    body: Body, track_id: int, time_s: float, lidar_from_world: AnyFloats, num_points: int
) -> TrackedObject:
    pose, after = body.world_from_body(time_s), body.world_from_body(time_s + _STEP_S)
    lidar_from_body, (middle, size) = lidar_from_world @ pose, body.model.box
    place, following = apply(pose, middle[None])[0], apply(after, middle[None])[0]
    return TrackedObject(
        track_id=track_id,
        center=apply(lidar_from_world, place[None])[0],
        size=np.asarray(size, np.float64),
        yaw=math.atan2(lidar_from_body[1, 0], lidar_from_body[0, 0]),
        velocity=lidar_from_world[:3, :3] @ (following - place) / _STEP_S,
        turn_rate=float(_velocity(pose, after)[5]),
        covariance=np.zeros((6, 6)),
        age_s=time_s,
        num_points=num_points,
    )


def _velocity(pose: AnyFloats, after: AnyFloats) -> Floats:
    """(6,) along and about the axes of a body, from its poses in the world."""
    step = np.asarray(invert(pose) @ after, np.float64)
    return SweepMotion.of_step(step, _STEP_S, 0.0).velocity
