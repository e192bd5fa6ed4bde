# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Lost returns: of surfaces that are smooth or wet and met at an angle, far, or in fog.

Rough surfaces reflect equally in all directions (Lambert), smooth ones return only rays near their
normal. A film of water makes all but the roughest smooth.
"""

import math
from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats, Bools
from mnsf_ros.recording.flow_truth import SurfaceClass

# Data sheets give the range for surfaces that return a tenth of the light.
_NOMINAL: Final = 0.1
_WHITE: Final = 100.0
# Standard deviation of the angle to the normal at which a smooth surface returns rays: walls at 6 m
# are seen over 3 m, as in the fog of `radiate_hdl32`, where walls at 5 to 8 m are over 1 to 7 m.
_LOBE_RAD: Final = math.radians(4.0)
# Layers of a surface of the same smoothness that a film of water is like.
_FILM: Final = 3.0
# Standard deviation of the logarithm of the light of a return.
_SPECKLE: Final = 0.5
# By class; others are rough.
_SMOOTH: Final = {
    **dict.fromkeys((SurfaceClass.CAR, SurfaceClass.LARGE_VEHICLE), 0.5),
    **dict.fromkeys((SurfaceClass.ROAD, SurfaceClass.SIDEWALK, SurfaceClass.BUILDING), 0.3),
}
SMOOTHNESS: Final = np.array([_SMOOTH.get(kind, 0.0) for kind in (0, *SurfaceClass)])


def reflectance(
    brightness: AnyFloats, smoothness: AnyFloats, wetness: float, cosines: AnyFloats
) -> AnyFloats:
    """Returns (N,) shares of the light that surfaces return.

    Their brightness (N,) is 0 to 255, 100 is white; their smoothness (N,), if dry, and the wetness
    are 0 to 1. The cosines (N,) are of the angles between rays and normals.
    """
    mirror = 1.0 - (1.0 - smoothness) ** (1.0 + _FILM * wetness)
    angles = np.arccos(np.clip(cosines, 0.0, 1.0))
    lobe = np.exp(-0.5 * (angles / _LOBE_RAD) ** 2)
    return (1.0 - mirror) * brightness / _WHITE * cosines + mirror * lobe


def are_returned(
    shares: AnyFloats, ranges: AnyFloats, reach_m: float, fog_per_m: float, rng: np.random.Generator
) -> Bools:
    """Returns the mask (N,) of the rays that the lidar receives, with speckle.

    `shares` (N,) are of the light that surfaces return, at ranges (N,) in metres; `reach_m` and
    `fog_per_m` as in `Sensor`.
    """
    light = shares / _NOMINAL * (reach_m / ranges) ** 2 * np.exp(-2.0 * fog_per_m * ranges)
    return light * rng.lognormal(0.0, _SPECKLE, len(light)) >= 1.0
