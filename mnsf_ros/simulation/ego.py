"""The vehicle that carries the lidar: where it drives, where it stops, how it sways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, planar_pose, tilt
from mnsf_ros.simulation.routes import SpeedProfile, Trip

SENSOR_HEIGHT_M = 1.73
EGO_LENGTH_M = 4.4
EGO_WIDTH_M = 1.8
BRAKING_M_S2 = 3.0
ACCELERATION_M_S2 = 2.5


@dataclass(frozen=True)
class Stop:
    """A halt before a crossing, from one time to another, in seconds of the recording."""

    begin_s: float
    end_s: float


@dataclass(frozen=True)
class EgoMotion:
    """The trip of the vehicle with the sway of its suspension.

    Attributes:
        trip: The planar motion of the sensor.
        sway: (3, 3) rows pitch (rad), roll (rad), heave (m); columns amplitude, Hz, phase.
    """

    trip: Trip
    sway: FloatArray

    def world_from_sensor(self, time_s: float) -> FloatArray:
        """Return the (4, 4) pose of the lidar frame (x forward, y left, z up) at a time."""
        amplitude, frequency, phase = self.sway.T
        pitch, roll, heave = amplitude * np.sin(2 * math.pi * frequency * time_s + phase)
        x, y, yaw = self.trip.planar(np.array([time_s]))[0]
        return planar_pose(x, y, yaw, SENSOR_HEIGHT_M + heave) @ tilt(pitch, roll)


def draw_sway(rng: np.random.Generator) -> FloatArray:
    """Return the sway of a car on its springs, see `EgoMotion`."""
    amplitudes = np.array([0.0020, 0.0015, 0.010])
    return np.stack([amplitudes, rng.uniform(0.7, 1.4, 3), rng.uniform(0.0, 2 * math.pi, 3)], 1)


def braking_distance(speed_m_s: float) -> float:
    """Return the meters needed to brake from a speed to a halt."""
    return speed_m_s**2 / (2 * BRAKING_M_S2)


def drive_with_stops(
    speed_m_s: float, stops_m: list[float], wait_s: float
) -> tuple[SpeedProfile, list[Stop]]:
    """Plan a drive that halts after each of the given distances.

    Args:
        speed_m_s: Cruising speed; 0 stands still the whole time.
        stops_m: Increasing distances from the start, far enough apart to speed up and brake.
        wait_s: How long each halt lasts.

    Returns:
        The speeds, and when the halts happen.
    """
    if speed_m_s == 0.0:
        return SpeedProfile.steady(0.0), [Stop(3.0, 3.0 + wait_s) for _ in stops_m]
    time, traveled = 0.0, 0.0
    times, speeds, stops = [time], [speed_m_s], []
    for distance in stops_m:
        cruise = distance - traveled - braking_distance(speed_m_s)
        brake_at = time + max(cruise / speed_m_s, 0.1)
        halt_at = brake_at + speed_m_s / BRAKING_M_S2
        leave_at = halt_at + wait_s
        time = leave_at + speed_m_s / ACCELERATION_M_S2
        times += [brake_at, halt_at, leave_at, time]
        speeds += [speed_m_s, 0.0, 0.0, speed_m_s]
        stops.append(Stop(halt_at, leave_at))
        traveled = distance + speed_m_s**2 / (2 * ACCELERATION_M_S2)
    return SpeedProfile(np.array(times), np.array(speeds)), stops
