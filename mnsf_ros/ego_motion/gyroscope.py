# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The rotation of the sensor by a gyroscope, whose bias is learned from registration."""

from collections import deque
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats
from mnsf_ros.ego_motion.sweep_motion import NUM_TURNS, Turns
from mnsf_ros.sweeps.rate_track import are_covered
from mnsf_ros.sweeps.sweep import Sweep

# Rates fit a registered rotation if they miss it by less than this angle, or share of the turn: a
# lidar that is shaken is registered badly. Rates in degrees/s or about other axes miss nearly all
# of it. Rates are used unless most of the last turns did not fit.
_MIN_ANGLE: Final = np.radians(1.0)
_MAX_SHARE: Final = 0.5
_MAX_JUDGED: Final = 9
# The bias is unknown before so many sweeps. It is a mean whose weights grow over so many: the first
# sweeps are registered without rates, and that of an MPU-6050 drifts by 0.3 degrees/s a kelvin.
_NUM_FIRST: Final = 3
_MEMORY: Final = 50


class Gyroscope:
    """Gives rotations by turn rates, as long as registered ones fit."""

    def __init__(self, *, is_used: bool) -> None:
        """Starts without a bias; not used, it never gives rotations."""
        self._is_used = is_used
        self._bias: Floats = np.zeros(3)
        self._num_compared = 0
        self._fits: deque[bool] = deque(maxlen=_MAX_JUDGED)

    def turn(self, sweep: Sweep, start_s: float, end_s: float) -> Floats | None:
        """Returns start_from_end (3, 3) between two times after the stamp; None if unknown."""
        found = self._orientations(sweep, np.array([start_s, end_s])) if self._is_used else None
        return None if found is None else found[-1]

    def turns(self, sweep: Sweep, moment_s: float) -> Turns | None:
        """Returns the rotations during a sweep with times of points; None if unknown."""
        if not self._is_used or sweep.times_s is None:
            return None
        first_s, last_s = sweep.span_s
        even_s = np.linspace(first_s, last_s, NUM_TURNS)
        times_s = np.union1d(even_s, [0.0, moment_s])
        found = self._orientations(sweep, times_s)
        if found is None:
            return None
        found = found[np.searchsorted(times_s, moment_s)].T @ found
        table = found[np.searchsorted(times_s, even_s)]
        return Turns(first_s, last_s, table, found[np.searchsorted(times_s, 0.0)])

    def learn(self, sweep: Sweep, start_s: float, end_s: float, registered: Floats) -> None:
        """Learns from the registered rotation start_from_end (3, 3) between two times."""
        times_s = np.array([start_s, end_s])
        found = self._orientations(sweep, times_s) if self._is_used and end_s > start_s else None
        if found is None:
            return
        missing, angle = _missing(found[-1], registered)
        does_fit = fits(found[-1], registered)
        if self._num_compared >= _NUM_FIRST and _MAX_SHARE * angle > _MIN_ANGLE:
            self._fits.append(does_fit)
        if does_fit or not self.is_good:
            self._num_compared = min(self._num_compared + 1, _MEMORY)
            gain = 2.0 / (self._num_compared + 1)
            self._bias = self._bias - gain * missing / (end_s - start_s)

    @property
    def is_good(self) -> bool:
        """Whether the bias is known, and most of the last rotations fitted registered ones."""
        return self._num_compared >= _NUM_FIRST and 2 * sum(self._fits) >= len(self._fits)

    def _orientations(self, sweep: Sweep, times_s: Floats) -> Floats | None:
        """(T, 3, 3) rotations first_from_each at increasing times; None where rates are missing."""
        rates, first_s, last_s = sweep.turn_rates, float(times_s[0]), float(times_s[-1])
        if rates is None or not are_covered(rates, first_s, last_s):
            return None
        known_s = rates[:, 0]
        edges_s = np.union1d(times_s, known_s[(known_s > first_s) & (known_s < last_s)])
        middles_s = (edges_s[1:] + edges_s[:-1]) / 2
        means = np.stack([np.interp(middles_s, known_s, rates[:, axis]) for axis in (1, 2, 3)], 1)
        steps = Rotation.from_rotvec((means - self._bias) * np.diff(edges_s)[:, None]).as_matrix()
        result = [np.eye(3)]
        for step in steps:
            result.append(result[-1] @ step)
        return np.stack(result)[np.searchsorted(edges_s, times_s)]


def fits(turn: Floats, registered: Floats) -> bool:
    """Returns whether a rotation by turn rates (3, 3) fits a registered one (3, 3)."""
    missing, angle = _missing(turn, registered)
    return bool(np.linalg.norm(missing) <= max(_MIN_ANGLE, _MAX_SHARE * angle))


def _missing(turn: Floats, registered: Floats) -> tuple[Floats, float]:
    """The rotation vector (3,) from a rotation to a registered one, and the larger angle."""
    missing = Rotation.from_matrix(turn.T @ registered).as_rotvec()
    return missing, max(Rotation.from_matrix(each).magnitude() for each in (turn, registered))
