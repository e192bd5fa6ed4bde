# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: odometry, or TF, fits the clouds."""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step
from mnsf_ros.settings import EgoMotionSettings

_ASSUMPTION: Final = "odometry fits the clouds"
# Both motions are compared at this range; odometry that is nearer than this is as good.
_FAR_M: Final = 15.0
_MIN_DIFFERENCE_M: Final = 0.2
# Share of the steps that may differ: registration is lost now and then, and a lidar that is carried
# sways within a sweep, by .22 m in a third of the steps.
_MAX_SHARE: Final = 0.4
_MIN_STEPS: Final = 3
# Registering two sweeps for this alone takes as long as an estimate.
_EVERY: Final = 50
# Residuals are compared in one step of so many, with a part of the points.
_COMPARED: Final = 4
_MAX_POINTS: Final = 40_000
_NUM_POINTS: Final = 2000
_NEAR_M: Final = 60.0
_LONGER: Final = 1.3  # residual under odometry over that under registration


class OdometryFit(Assumption):
    """Compares the motion by odometry with the registered one, and the residuals of both."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._settings = replace(settings, source=EgoSource.REGISTRATION.value)
        # Difference in metres, and both residuals, NaN where they need not be compared.
        self._steps: deque[tuple[float, float, float]] = deque(maxlen=100)
        self._num, self._since_compared = 0, _COMPARED

    def move(self, step: Step) -> None:
        """Takes the motion to the next sweep."""
        before, after = step.before.sweep, step.after.sweep
        if before.odometry is None or after.odometry is None:
            return
        registered = step.before_from_after
        if step.after.source != EgoSource.REGISTRATION.value:
            self._num += 1
            if self._num % _EVERY != 1:
                return
            registration = EgoMotion(self._settings)
            registration.pose_of(before)
            registered = registration.pose_of(after).world_from_stamp
        motion = np.linalg.inv(before.odometry) @ after.odometry
        difference_m = _difference_m(motion, registered)
        residuals_m = (np.nan, np.nan)
        self._since_compared += 1
        if difference_m > _MIN_DIFFERENCE_M and self._since_compared >= _COMPARED:
            self._since_compared = 0
            target = before.xyz[:: 1 + len(before) // _MAX_POINTS]
            own = after.xyz[:: 1 + len(after) // _NUM_POINTS].astype(np.float64)
            residuals_m = _residual_m(target, own, motion), _residual_m(target, own, registered)
        self._steps.append((difference_m, *residuals_m))

    def facts(self) -> dict[str, str]:
        """Difference from registration, in words."""
        if not self._steps:
            return {}
        typical_m = float(np.median([one[0] for one in self._steps]))
        text = f"differs from registration by {typical_m:.2f} m a sweep, {_FAR_M:.0f} m away"
        return {"odometry": text}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if len(self._steps) < _MIN_STEPS:
            return
        differences_m, own_m, registered_m = np.array(self._steps).T
        contradicted = own_m > _LONGER * registered_m
        confirmed = registered_m > _LONGER * own_m
        num_compared = np.count_nonzero(np.isfinite(own_m))
        # Steps that differ little are not compared, and fit.
        differing = np.mean(differences_m > _MIN_DIFFERENCE_M)
        share = float(differing * np.count_nonzero(contradicted) / max(num_compared, 1))
        text = (
            f"odometry and registration differ in {differing:.0%} of the sweeps, by "
            f"{np.median(differences_m):.2f} m in the median"
        )
        if share > _MAX_SHARE:
            yield Finding(
                _ASSUMPTION,
                Severity.ERROR,
                f"odometry contradicts the clouds in {share:.0%} of the sweeps, by "
                f"{np.median(differences_m[contradicted]):.2f} m: static points are off by "
                f"{np.median(own_m[contradicted]):.2f} m under it, by "
                f"{np.median(registered_m[contradicted]):.2f} m under registration",
                "Set ego_motion.source=registration, until the stamps of the odometry and the pose "
                "of the sensor (ego_motion.sensor_x_m and others) are corrected",
            )
        elif differing > _MAX_SHARE and 2 * np.count_nonzero(confirmed) > num_compared:
            yield Finding(
                _ASSUMPTION,
                Severity.ERROR,
                f"{text}, and static points fit odometry: they are off by "
                f"{np.median(own_m[confirmed]):.2f} m under it, by "
                f"{np.median(registered_m[confirmed]):.2f} m under registration",
                "Set ego_motion.source=odometry, or check for gaps between the clouds",
            )
        elif differing > _MAX_SHARE:
            yield Finding(
                _ASSUMPTION,
                Severity.WARNING,
                f"{text}, and the clouds do not tell which is right",
                "Check for gaps between the clouds, the stamps of both, and the pose of the sensor "
                "(ego_motion.sensor_x_m and others); in tunnels and bare corridors odometry is "
                "right (ego_motion.source=odometry)",
            )


def _difference_m(first: Floats, second: Floats) -> float:
    """How far two motions (4, 4) move a point that is far away apart."""
    off = np.linalg.inv(first) @ second
    angle = np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1))
    return float(np.linalg.norm(off[:3, 3]) + _FAR_M * angle)


def _residual_m(target: Floats32, xyz: Floats, motion: Floats) -> float:
    """Mean distance of moved points (N, 3) from the points (T, 3) of a sweep, metres."""
    near = xyz[np.abs(xyz).max(axis=1, initial=0.0) < _NEAR_M]
    moved = apply(motion, near).astype(np.float32)
    nearest = PointGrid(target).nearest(moved)
    distances_m = np.full(len(moved), REACH_M)
    found = nearest >= 0
    distances_m[found] = np.linalg.norm(moved[found] - target[nearest[found]], axis=1)
    return float(distances_m.mean()) if len(moved) else 0.0
