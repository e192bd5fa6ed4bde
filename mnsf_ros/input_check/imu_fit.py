# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the turn rates of an IMU fit the clouds."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step

_ASSUMPTION: Final = "turn rates of the IMU fit the clouds"
# Steps that are compared, once the turn rate has varied by so much (standard deviation).
_MAX_STEPS: Final = 100
_MIN_STEPS: Final = 10
_MIN_VARIATION: Final = np.radians(5.0)
# The registered rate of a lidar that is shaken is noisy.
_MIN_CORRELATION: Final = 0.5
_FACTORS: Final = (0.5, 2.0)
_DEGREES: Final = 180 / np.pi


class ImuFit(Assumption):
    """Compares the turn rates of an IMU with the registered ones."""

    def __init__(self) -> None:
        self._steps: deque[Floats] = deque(maxlen=_MAX_STEPS)

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        rates = step.after.sweep.turn_rates
        if rates is None:
            return
        own = rates[(rates[:, 0] >= -step.interval_s) & (rates[:, 0] <= 0.0), 1:]
        if len(own):
            turn = Rotation.from_matrix(step.before_from_after[:3, :3]).as_rotvec()
            self._steps.append(np.stack([own.mean(axis=0), turn / step.interval_s]))

    def facts(self) -> dict[str, str]:
        """Bias of the rates, in words."""
        if not self._steps or any(self.findings()):
            return {}
        measured, registered = np.median(self._steps, axis=0)
        bias = ", ".join(f"{value:.1f}" for value in np.degrees(measured - registered))
        return {"IMU": f"used, its bias is {bias} degrees/s"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._steps) < _MIN_STEPS:
            return
        steps = np.stack(self._steps)
        # Without the bias.
        measured, registered = np.moveaxis(steps - steps.mean(axis=0), 1, 0)
        variation = np.linalg.norm(registered) / np.sqrt(len(steps))
        if variation < _MIN_VARIATION:
            return
        size = max(float(np.linalg.norm(measured)), 1e-9)
        correlation = float((measured * registered).sum() / size / np.linalg.norm(registered))
        factor = size / float(np.linalg.norm(registered))
        low, high = _FACTORS
        if correlation > _MIN_CORRELATION and low < factor < high:
            return
        text = (
            f"turn rates contradict the clouds: {factor:.2g} times the registered ones, with a "
            f"correlation of {correlation:.2f}"
        )
        remedy = "Check the rotation of its frame by TF; meanwhile the IMU is not used"
        if correlation > _MIN_CORRELATION and low < factor / _DEGREES < high:
            text += ": they are in degrees/s"
            remedy = "Let its driver send rad/s; meanwhile the IMU is not used"
        yield Finding(_ASSUMPTION, Severity.WARNING, text, remedy)
