"""How bright a point looks: by material, with painted lines on the asphalt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation.bodies import SurfaceClass
from mnsf_ros.simulation.street import PARKING_LATERAL_M, Street

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mnsf_ros.geometry.transforms import FloatArray

_ASPHALT, _SIDEWALK, _PAINT = 22.0, 48.0, 150.0
_SPECKLE = 5.0


def intensities(
    street: Street,
    world: FloatArray,
    class_id: NDArray[np.uint8],
    reflectivity: FloatArray,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return (N,) intensities from 0 to 255.

    Args:
        street: The ground plan, for the painted lines.
        world: (N, 3) points in world meters.
        class_id: (N,) surface class of each point.
        reflectivity: (N,) mean intensity of the body each point is on; ignored on the ground.
        rng: Source of the speckle.
    """
    brightness = reflectivity.copy()
    brightness[class_id == SurfaceClass.SIDEWALK] = _SIDEWALK
    road = np.flatnonzero(class_id == SurfaceClass.ROAD)
    painted = _is_painted(street, world[road, 0], world[road, 1])
    brightness[road] = np.where(painted, _PAINT, _ASPHALT)
    brightness += rng.normal(0.0, _SPECKLE, len(brightness))
    return np.clip(brightness, 0.0, 255.0).astype(np.float32)


def _is_painted(street: Street, x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
    """Tell which places on the asphalt belong to a center dash, a parking line or a zebra."""
    lateral = street.centerline.lateral(x, y)
    dashes = (np.abs(lateral) < 0.08) & (x % 9.0 < 4.0)
    parking = np.abs(np.abs(lateral) - (PARKING_LATERAL_M - 1.15)) < 0.06
    painted = dashes | parking
    for crossing in street.crossings:
        along = crossing.along(x, y)
        painted &= np.abs(along) > 9.0
        painted |= (np.abs(along + 7.0) < 1.4) & (lateral % 1.0 < 0.5)
    return painted
