# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A sweep, the triplet of one estimate, and where an estimate starts."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.sweeps.mounting import Mounting

NANOSECONDS = 1_000_000_000
# Interval of most lidars, where stamps are missing.
USUAL_INTERVAL_S = 0.1
# (3, 3), of beams that turn about the z of the sensor's frame.
NOT_TILTED = np.eye(3)
NOT_TILTED.flags.writeable = False
NUM_SOME: Final = 512
# Where some points are in a cloud, 0 to 1: one in each part, as the noise of a lidar changes each
# point. At even steps there would be the same few beams of some clouds.
_SOME: Final = (np.arange(NUM_SOME) + np.random.default_rng(0).random(NUM_SOME)) / NUM_SOME


@dataclass(frozen=True, eq=False)
class Sweep:
    """The points of one lidar revolution, in the sensor's own frame.

    Attributes:
        xyz: (N, 3) float32, metres, finite. Methods get it with z up, see `levelled`.
        stamp_ns: Time of the sweep, integer nanoseconds.
        frame_id: Name of the sensor's coordinate frame.
        source: The undecoded input, carried along for the caller.
        odometry: (4, 4) float64, world_from_sensor by the robot's odometry; None if unknown.
        kept: (N,) bool, the points whose flow is estimated. None: chosen by the settings of crop
            and ground.
        times_s: (N,) float32, seconds from the stamp to the measurement of each point, negative
            before it. None if unknown: the sweep counts as taken in one moment.
        mounting: How the sensor is mounted; None if unknown, or level.
        turn_rates: (K, 4) float64, turn rates by an IMU in the order of time, from before the sweep
            to its end: seconds from the stamp, then rad/s about x, y and z. None without an IMU.
        beams_from_sensor: (3, 3) rotation to axes of which z is what the beams turn about.
    """

    xyz: Floats32
    stamp_ns: int = 0
    frame_id: str = ""
    source: Any = None
    odometry: Floats | None = None
    kept: Bools | None = None
    times_s: Floats32 | None = None
    mounting: Mounting | None = None
    turn_rates: Floats | None = None
    beams_from_sensor: Floats = field(default_factory=lambda: NOT_TILTED)

    def __post_init__(self) -> None:
        """Copies arrays that are read-only or not contiguous: compiled loops take no others."""
        for name in ("xyz", "kept", "times_s"):
            array = getattr(self, name)
            if array is not None:
                object.__setattr__(self, name, np.require(array, requirements=("C", "W")))

    def __str__(self) -> str:
        """Names it in messages."""
        return f"sweep at {self.stamp_ns / NANOSECONDS:.3f} s"

    @property
    def span_s(self) -> tuple[float, float]:
        """Seconds from the stamp to the first and to the last point; 0 if unknown."""
        times_s = self.times_s
        if times_s is None or len(times_s) == 0:
            return 0.0, 0.0
        return float(times_s.min()), float(times_s.max())

    @property
    def middle_s(self) -> float:
        """Seconds from the stamp to the middle of the points' times; 0 if unknown."""
        first_s, last_s = self.span_s
        return (first_s + last_s) / 2

    def repeats(self, other: "Sweep") -> bool:
        """Whether it has the points of an older sweep."""
        is_newer = self.stamp_ns > other.stamp_ns
        is_like = is_newer and self.fingerprint == other.fingerprint
        return is_like and np.array_equal(self.xyz, other.xyz)

    @cached_property
    def some_xyz(self) -> Floats32:
        """(512, 3) metres, some of the points, spread over the cloud; (0, 3) without any."""
        return self.xyz.take(self._some_rows, axis=0) if len(self) else self.xyz

    @property
    def some_times_s(self) -> Floats32 | None:
        """(512,) seconds, the times of `some_xyz`; None if unknown."""
        times_s = self.times_s
        return times_s if times_s is None or not len(self) else times_s.take(self._some_rows)

    @property
    def _some_rows(self) -> Ints:
        return (_SOME * len(self)).astype(np.int64)

    @cached_property
    def fingerprint(self) -> bytes:
        """8 bytes that are equal for equal clouds: of some points, and of their number.

        Stamps do not count. Without noise a change of few points may go unnoticed: see `repeats`.
        """
        salt = len(self).to_bytes(8, "little")
        return hashlib.blake2b(self.some_xyz.tobytes(), digest_size=8, salt=salt).digest()

    @property
    def rings(self) -> NDArray[np.integer[Any]] | None:
        """(N,) number of the beam of each point, if its source knows them."""
        return getattr(self.source, "rings", None)

    @property
    def tilt(self) -> Mounting | None:
        """The mounting, unless the frame is level already."""
        return None if self.mounting is None or self.mounting.is_level else self.mounting

    @property
    def levelled(self) -> "Sweep":
        """The sweep in a level frame whose origin is the lens; itself if that is its own frame.

        Always the same object: methods know sweeps again by it.
        """
        # A sweep that refers to itself would live until the garbage collector comes.
        return self if self.tilt is None else self._levelled

    @cached_property
    def _levelled(self) -> "Sweep":
        mounting, odometry = self.mounting, self.odometry
        assert mounting is not None  # noqa: S101 - see `levelled`
        levelled = replace(
            self,
            xyz=transformed(self.xyz, mounting.level_from_sensor),
            odometry=None if odometry is None else odometry @ mounting.sensor_from_level,
            mounting=None,
            beams_from_sensor=self.beams_from_sensor @ mounting.sensor_from_level[:3, :3],
        )
        return levelled.turning(self.turn_rates, mounting.level_from_sensor)

    def turning(self, turn_rates: Floats | None, sensor_from_imu: Floats) -> "Sweep":
        """Returns the sweep with turn rates (K, 4) about the axes of an IMU, which is at (4, 4)."""
        if turn_rates is None:
            return self
        about_own = turn_rates[:, 1:] @ sensor_from_imu[:3, :3].T
        return replace(self, turn_rates=np.column_stack([turn_rates[:, :1], about_own]))

    @property
    def kept_xyz(self) -> Floats32:
        """The kept points, (M, 3) metres; all points without a choice."""
        return self.xyz if self.kept is None else self.xyz[self.kept]

    def part(self, rows: Bools | Ints) -> "Sweep":
        """Returns some points, by a mask (N,) or their numbers, with their columns.

        The `source` stays that of all points.
        """
        return replace(
            self,
            xyz=self.xyz[rows],
            kept=None if self.kept is None else self.kept[rows],
            times_s=None if self.times_s is None else self.times_s[rows],
        )

    @classmethod
    def from_array(
        cls, points: object, *, name: str = "points", stamp_ns: int = 0, frame_id: str = ""
    ) -> "Sweep":
        """Checks an array of points in metres, (N, 3) or wider, and makes a sweep of it.

        Columns beyond the third are ignored. `name` is the name of the array in error texts.

        Raises:
            SweepError: If the array is not two-dimensional with at least three columns, is not
                numeric, or holds values that are not finite as float32.
        """
        try:
            array = np.asarray(points)
        except ValueError as error:
            raise SweepError(
                f"{name}: got rows of different lengths, expected (N, 3) numbers"
            ) from error
        if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
            raise SweepError(
                f"{name}: got shape {array.shape} of {array.dtype}, expected (N, 3) numbers"
            )
        with np.errstate(over="ignore"):
            xyz = np.ascontiguousarray(array[:, :3], dtype=np.float32)
        num_bad = int(np.count_nonzero(~np.isfinite(xyz).all(axis=1)))
        if num_bad:
            raise SweepError(f"{name}: {num_bad} of {len(xyz)} points are not finite; remove them")
        return cls(xyz, stamp_ns, frame_id)

    def __len__(self) -> int:
        return len(self.xyz)

    def __repr__(self) -> str:
        """Number of points, stamp and frame, without the arrays."""
        return f"Sweep(points={len(self)}, stamp_ns={self.stamp_ns}, frame_id={self.frame_id!r})"


class Start(Enum):
    """Where an estimate starts: from the last one, or from scratch, and why."""

    WARM = "warm"
    COLD_BY_SETTING = "cold: warm start is off"
    COLD_FIRST = "cold: first triplet"
    COLD_GAP = "cold: gap since the last triplet"
    COLD_TIME_JUMP = "cold: time went back"
    COLD_FRAME = "cold: frame_id changed"
    COLD_SETTINGS = "cold: settings changed"
    COLD_TIMES = "cold: times of points found"
    COLD_NETWORKS = "cold: fresh networks"


@dataclass(frozen=True, eq=False)
class SweepTriplet:
    """Three consecutive sweeps: S1 (t-1), S2 (t) and S3 (t+1) of the paper.

    Attributes:
        previous: The sweep at t-1. It may be missing: the estimate then uses two sweeps only.
        current: The sweep at t, whose flow is estimated.
        next: The sweep at t+1.
        earlier: The sweeps at t-2, t-3 ..., for methods that use more than three.
        next_from_current: (4, 4) rigid motion of static points between the two sensor frames,
            x_next = next_from_current · x_current, for methods that need it.
    """

    previous: Sweep | None
    current: Sweep
    next: Sweep
    earlier: tuple[Sweep, ...] = ()
    next_from_current: Floats | None = None

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """All sweeps, oldest first."""
        return (*reversed(self.before), self.current, self.next)

    @property
    def levelled(self) -> "SweepTriplet":
        """The triplet of the levelled sweeps."""
        tilt, motion = self.current.tilt, self.next_from_current
        if tilt is None:
            return self
        if motion is not None:
            motion = tilt.level_from_sensor @ motion @ tilt.sensor_from_level
        return replace(self.changed(lambda sweep: sweep.levelled), next_from_current=motion)

    def changed(self, change: Callable[[Sweep], Sweep]) -> "SweepTriplet":
        """Returns the triplet with each of its sweeps changed."""
        return replace(
            self,
            previous=None if self.previous is None else change(self.previous),
            current=change(self.current),
            next=change(self.next),
            earlier=tuple(change(sweep) for sweep in self.earlier),
        )

    @property
    def interval_s(self) -> float:
        """Seconds from the current to the next sweep."""
        return (self.next.stamp_ns - self.current.stamp_ns) / NANOSECONDS

    @property
    def before(self) -> tuple[Sweep, ...]:
        """The sweeps at t-1, t-2 ..."""
        return () if self.previous is None else (self.previous, *self.earlier)

    @property
    def interval_ratio(self) -> float:
        """Interval to the next sweep over interval from the previous one; 1 without stamps."""
        return self.interval_ratios[0] if self.before else 1.0

    @property
    def interval_ratios(self) -> tuple[float, ...]:
        """Interval to the next sweep over that from each one before: t-1, t-2 ...

        Without stamps they are 1, 1/2 ...
        """
        after = self.next.stamp_ns - self.current.stamp_ns
        intervals = (self.current.stamp_ns - sweep.stamp_ns for sweep in self.before)
        return tuple(
            after / interval if interval > 0 and after > 0 else 1.0 / number
            for number, interval in enumerate(intervals, start=1)
        )
