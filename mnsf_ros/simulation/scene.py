# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a simulated lidar measures."""

from dataclasses import dataclass

from mnsf_ros.simulation.bodies import Body
from mnsf_ros.simulation.routes import SensorTrip
from mnsf_ros.simulation.sensor import Sensor
from mnsf_ros.simulation.street import Street


@dataclass(frozen=True)
class Scene:
    """Ground, everything on it, and the vehicle, robot or person with the lidar.

    `wetness` of all surfaces is 0 to 1; `text` describes the scene in a line.
    """

    street: Street
    bodies: tuple[Body, ...]
    ego: SensorTrip
    sensor: Sensor
    text: str
    wetness: float = 0.0
