# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: z is up, and the origin of the frame is the lidar, as the stream estimated it."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.sweeps.mounting import tilt_deg
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate

_UP: Final = "z is up"
_LENS: Final = "the origin of the frame is the lidar"
# Without cones around a lens near by: two lidars in a cloud, or one corrected for its motion.
_MAX_BLUR_DEG: Final = 1.0
# The lens of a lidar is higher above the ground.
_MIN_LENS_M: Final = 0.2
# Of a normal of the ground: 3 degrees.
_NOISE: Final = 0.05
_PLACE_REMEDY: Final = (
    "Publish clouds in the frame of the lidar, or set lidars.frame to this frame, lidars.poses to "
    "parameters, and lidar_1.x_m to lidar_1.z_m to the place of the lidar"
)


class LevelFrame(Assumption):
    """Says what the stream found of the mounting, unless parameters or TF say it."""

    def __init__(self, estimate: MountingEstimate) -> None:
        self._estimate = estimate

    def facts(self) -> dict[str, str]:
        """Beams, lens, height and tilt, in words."""
        cones = self._estimate.cones
        beams = {} if cones is None else {"beams": f"{cones.num_beams}"}
        return {**beams, "mounting": self._estimate.text}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        found, ground, cones = self._estimate.found, self._estimate.ground, self._estimate.cones
        if ground is None:
            return
        if found is None:
            x, y, z = np.where(np.abs(ground[:3]) < _NOISE, 0.0, ground[:3])
            roll_deg, pitch_deg = np.degrees((np.arctan2(y, z), -np.arcsin(np.clip(x, -1, 1))))
            remedy = (
                f"If the lidar is mounted so, set lidar_1.roll_deg={roll_deg:.0f} and "
                f"lidar_1.pitch_deg={pitch_deg:.0f}; if that is a wall, nothing needs doing"
            )
            yield Finding(_UP, Severity.ERROR, _tilt_text(ground[:3]), remedy)
        elif found.tilt_deg > 0:
            text = f"{_tilt_text(found.level_from_sensor[2, :3])}; methods get the clouds upright"
            remedy = (
                "Nothing needs doing; lidar_1.roll_deg and lidar_1.pitch_deg would make it exact"
            )
            yield Finding(_UP, Severity.INFO, text, remedy)
        if found is not None and found.lens_m.any():
            text = f"the lidar is not at the origin of the frame, but at {found.place}"
            yield Finding(
                _LENS, Severity.INFO, f"{text}; methods see from there", "Nothing needs doing"
            )
        elif cones is not None and cones.blur_deg > _MAX_BLUR_DEG:
            text = f"beams are {cones.blur_deg:.1f} degrees off cones around the origin"
            text += ", and no place near it is better"
            yield Finding(_LENS, Severity.WARNING, text, _PLACE_REMEDY)
        elif found is not None and ground[3] < _MIN_LENS_M:
            side = "above" if ground[3] > 0 else "below"
            text = f"the origin is {abs(ground[3]):.2f} m {side} the ground, so it is not the lidar"
            yield Finding(_LENS, Severity.WARNING, text, _PLACE_REMEDY)


def _tilt_text(up: Floats) -> str:
    axis = int(np.argmax(np.abs(up)))
    nearest = f"{'-' if up[axis] < 0 else ''}{'xyz'[axis]}"
    text = f"z is {tilt_deg(up):.0f} degrees off the normal of the ground"
    return text if nearest == "z" else f"{text}, up is nearest to {nearest}"
