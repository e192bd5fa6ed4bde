# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a lidar sees in a bare hall with a flat ceiling: rays from inside a box, and a person."""

import numpy as np

SENSOR_HEIGHT_M = 0.9
_PERSON = np.array([0.5, 0.4])
_PERSON_M = 1.7
_NOISE_M = 0.01


def hall(place, size, num_beams=32, half_deg=25.0, seed=0, person=None):
    """(N, 3) float32, sensor frame, and (N,) which of them are on the person.

    Args:
        place: x, y of the sensor from the middle of the hall, metres; it looks along x.
        size: Length, width and height of the hall, metres.
        num_beams: Of the lidar.
        half_deg: Of its view, above and below the horizon.
        seed: Of the noise, and of the directions.
        person: x, y of its middle, if there is one.
    """
    rng = np.random.default_rng(seed)
    azimuths = (np.arange(900) + rng.uniform()) * 2 * np.pi / 900
    elevations = np.radians(np.linspace(-half_deg, half_deg, num_beams))[:, None]
    level = np.cos(elevations)
    rise = np.broadcast_to(np.sin(elevations), (num_beams, 900))
    rays = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), rise], axis=-1)
    rays = rays.reshape(-1, 3)
    sensor = np.array([*place, SENSOR_HEIGHT_M])
    walls = np.array(size) * [[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]] - sensor
    ranges = (np.where(rays > 0, walls[1], walls[0]) / rays).min(axis=1)
    are_person = np.zeros(len(rays), bool)
    if person is not None:
        low = np.array([*(person - _PERSON / 2), 0.0]) - sensor
        high = np.array([*(person + _PERSON / 2), _PERSON_M]) - sensor
        near = np.minimum(low / rays, high / rays).max(axis=1)
        far = np.maximum(low / rays, high / rays).min(axis=1)
        are_person = (near > 0) & (near < far) & (near < ranges)
        ranges = np.where(are_person, near, ranges)
    ranges = ranges + rng.normal(0, _NOISE_M, len(ranges))
    return (rays * ranges[:, None]).astype(np.float32), are_person
