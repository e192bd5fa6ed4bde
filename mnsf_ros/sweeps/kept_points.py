"""The points of a sweep that fields are fitted to: inside the crop, and not ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.cropping import crop_mask
from mnsf_ros.sweeps.ground import ground_mask


def kept_mask(xyz: NDArray[np.float32], settings: Settings) -> NDArray[np.bool_]:
    """Says which points are kept.

    Args:
        xyz: (N, 3) metres, sensor frame.
        settings: Of crop and ground.

    Returns:
        (N,) bool.
    """
    kept = crop_mask(xyz, settings.crop)
    if settings.ground.remove:
        # np.compress is several times faster than xyz[kept].
        kept[kept] = ~ground_mask(np.compress(kept, xyz, axis=0), settings.ground)
    return kept
