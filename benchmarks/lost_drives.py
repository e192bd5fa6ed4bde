# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Drives with a disturbance, and what is true of their sweeps: simulated ones, and cut real ones.

The motion of the sensor is known at any time, also where its clouds are missing or frozen: the true
flow of a point at rest is the motion of the sensor to the next sweep.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
from drives import DATA
from numpy.typing import NDArray

from mnsf_ros.geometry.transforms import apply, invert, planar_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model, box
from mnsf_ros.simulation.routes import Route, SensorTrip, SpeedProfile, Trip
from mnsf_ros.simulation.scene import Scene
from mnsf_ros.simulation.sensor import Sensor
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import LANE_LATERAL_M
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.simulation.traffic import walk
from mnsf_ros.simulation.worlds import build_scene
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Highest beam (degrees), beams, columns, and whether each point has its own time.
SENSORS: Final = {
    "16 beams, ±15°": (15.0, 16, 640, False),
    "32 beams, ±25°": (25.0, 32, 1024, False),
    "32 beams, ±45°": (45.0, 32, 600, False),
    "16 beams, ±15°, rolling": (15.0, 16, 640, True),
}
# Speeds of the sensor in m/s; places under a roof draw theirs.
PLACES: Final = {"street": (1.8, 8.0, 15.0), "rooms": (0.0,), "carried": (0.0,)}
REAL: Final = ("kitti_0005", "apollo_arz034", "radiate_hdl32")
# Sweeps before a disturbance, and after it.
_BEFORE: Final = 15
_AFTER: Final = 25
_RATE_HZ: Final = 10.0
_FROZEN_S: Final = (0.3, 1.0, 3.0, 10.0)
_COVERED_S: Final = (1.0, 4.0)
_GAPS_S: Final = (0.2, 0.5, 1.0, 1.5, 3.0)
_RATES_HZ: Final = (2.0, 5.0, 10.0, 20.0)
# Turns in degrees a sweep, pushes and buses in m/s, and how long turns and pushes last.
_TURNS_DEG: Final = (15.0, 30.0, 60.0)
_TURN_S: Final = 0.6
_PUSHES_M_S: Final = (1.0, 3.0)
_PUSH_S: Final = 0.5
_BUSES_M_S: Final = (3.0, 8.0)
# How far the middle of a bus is beside the lidar, which is 1.25 m more than its side; and how far
# ahead it is when it hides little.
_BUS_BESIDE_M: Final = 2.4
_BUS_GONE_M: Final = 12.0
_STANDS_S: Final = 2.0
# When it drives so fast that to stand would be wrong.
_STARTED_S: Final = 2.5
# Walking speeds of the middle of a door; its width, the height of the doorway, its distance ahead.
_DOORS_M_S: Final = (0.5, 1.5)
_DOOR_M, _DOORWAY_M, _DOOR_AHEAD_M = 1.1, 2.1, 1.2
# A covered lidar sees its cover, and is turned meanwhile.
_COVER_M: Final = 0.45
_COVER_POINTS: Final = 3000
_COVER_TURN_DEG: Final = 130.0
# Sweeps of a real drive before a gap, and the fewest after it.
_REAL_BEFORE: Final = 4
_REAL_AFTER: Final = 5
# One of them sees the roof of its own car.
_OWN_CAR_M: Final = 3.0


class Case(NamedTuple):
    """What a disturbance is tried on: a simulated place, or a real drive."""

    disturbance: str
    place: str
    sensor: str
    speed_m_s: float
    seed: int


@dataclass(frozen=True, eq=False)
class Taken:
    """A sweep as the stream gets it, and what is true of it.

    Attributes:
        sweep: Its points (N, 3).
        pose_at: Seconds after the stamp to world_from_sensor, (4, 4).
        static: (N,) bool, the points that are known to be at rest.
        above_ground: (N,) bool, the points that are not on the ground.
        is_continuous: Whether poses are known between stamps, too; else flow is that of the stamps.
    """

    sweep: Sweep
    pose_at: Callable[[float], NDArray[Any]]
    static: NDArray[np.bool_]
    above_ground: NDArray[np.bool_]
    is_continuous: bool = True

    def static_flow(self, following: "Taken") -> NDArray[Any]:
        """(N, 3) metres to the places of points at rest in the frame of the following sweep.

        As in recordings, that is the frame as long after its stamp as a point is after its own.
        """
        xyz, times_s = self.sweep.xyz.astype(float), self.sweep.times_s
        if times_s is None or not self.is_continuous:
            return apply(self.motion_to(following), xyz) - xyz
        flow = np.empty_like(xyz)
        for after_s in np.unique(times_s):
            own = times_s == after_s
            flow[own] = apply(self.motion_to(following, float(after_s)), xyz[own]) - xyz[own]
        return flow

    def motion_to(self, following: "Taken", after_s: float = 0.0) -> NDArray[Any]:
        """(4, 4) next_from_current of points at rest, so long after both stamps."""
        return invert(following.pose_at(after_s)) @ self.pose_at(after_s)


@dataclass(frozen=True, eq=False)
class Drive:
    """Sweeps of a case with one variant of its disturbance.

    Attributes:
        variant: Its strength, in words.
        sweeps: In the order of time.
        end: Number of the first sweep after the disturbance; None if it does not end.
        rate_hz: Usual number of sweeps in a second.
        undisturbed: All sweeps of a drive whose movers nobody has labelled.
    """

    variant: str
    sweeps: Sequence[Taken]
    end: int | None
    rate_hz: float = _RATE_HZ
    undisturbed: Sequence[Taken] = ()


def cases(disturbance: str, seeds: Sequence[int]) -> Iterator[Case]:
    """Yields all cases of a disturbance."""
    for place, speeds in PLACES.items():
        if place in _ONLY_IN.get(disturbance, PLACES):
            is_moved = disturbance in _OF_MOTION
            sensors = [name for name, each in SENSORS.items() if is_moved or not each[-1]]
            for sensor, speed_m_s, seed in product(sensors, speeds, seeds):
                yield Case(disturbance, place, sensor, speed_m_s, seed)
    if disturbance == "gap":
        yield from (Case(disturbance, place, "", 0.0, seed) for place in REAL for seed in seeds)


def drives(case: Case) -> Iterator[Drive]:
    """Yields the variants of a case."""
    return DISTURBANCES[case.disturbance](case)


def _unchanged(scene: Scene) -> Scene:
    return scene


class Place:
    """A simulated place, of which each sweep is simulated once."""

    def __init__(
        self,
        case: Case,
        change: Callable[[Scene], Scene] = _unchanged,
        *,
        duration_s: float = 10.0,
        rate_hz: float = _RATE_HZ,
        **settings: float | str,
    ) -> None:
        """Builds the place of a case, with further settings of the simulation and a change."""
        if case.place == "street":
            settings |= {"ego_speed_m_s": case.speed_m_s}
        high_deg, num_beams, num_columns, is_rolling = SENSORS[case.sensor]
        drawn = SimulationSettings(case.seed, duration_s, scenario=case.place, **settings)
        sensor = Sensor(
            kind=case.sensor,
            elevations_deg=np.linspace(-high_deg, high_deg, num_beams),
            num_columns=num_columns,
            rate_hz=rate_hz,
            range_noise_m=0.015,
            dropout=0.02,
            max_range_m=100.0,
            is_rolling=is_rolling,
            min_range_m=0.3,
            is_fixed=drawn.directions == "fixed",
        )
        scene = change(replace(build_scene(drawn), sensor=sensor))
        self._simulator = SweepSimulator(drawn, scene)
        self._taken: dict[int, Taken] = {}

    def take(self, index: int) -> Taken:
        """Returns a sweep."""
        if index not in self._taken:
            simulator = self._simulator
            simulated = simulator.sweep(index)
            truth, times_ns = simulated.truth, simulated.columns.get("t")
            times_s = None if times_ns is None else (times_ns / NANOSECONDS).astype(np.float32)
            sweep = Sweep(simulated.xyz, truth.stamp_ns, "lidar", times_s=times_s)
            pose_at = partial(_pose_of, simulator.scene.ego, float(simulator.times_s[index]))
            static = truth.valid & ~truth.dynamic
            self._taken[index] = Taken(sweep, pose_at, static, ~truth.ground)
        return self._taken[index]

    def taken(self, numbers: range) -> list[Taken]:
        """Returns consecutive sweeps."""
        return [self.take(number) for number in numbers]


def _pose_of(ego: SensorTrip, stamp_s: float, after_s: float) -> NDArray[Any]:
    return ego.world_from_sensor(stamp_s + after_s)


def _gaps(case: Case) -> Iterator[Drive]:
    """No sweeps for a while: of real drives, too."""
    if case.place in REAL:
        yield from _real_gaps(case)
        return
    place = Place(case)
    for gap_s in _GAPS_S:
        first = _BEFORE - 1 + round(gap_s * _RATE_HZ)
        after = place.taken(range(first, first + _AFTER))
        yield Drive(f"{gap_s:g} s", [*place.taken(range(_BEFORE)), *after], _BEFORE)


def _real_gaps(case: Case) -> Iterator[Drive]:
    """Gaps in a real drive, from a sweep on that the seed chooses."""
    sweeps = _real_sweeps(case.place)
    if not sweeps:
        return
    undisturbed = () if case.place == "kitti_0005" else sweeps
    stamps_s = np.array([each.sweep.stamp_ns for each in sweeps]) / NANOSECONDS
    rate_hz = 1.0 / float(np.median(np.diff(stamps_s)))
    before = _REAL_BEFORE + case.seed % 5
    yield Drive("none", sweeps, None, rate_hz, undisturbed)
    for gap_s in _GAPS_S:
        first = before - 1 + round(gap_s * rate_hz)
        if first + _REAL_AFTER <= len(sweeps):
            cut = [*sweeps[:before], *sweeps[first:]]
            yield Drive(f"{gap_s:g} s", cut, before, rate_hz, undisturbed)


def _real_sweeps(name: str) -> list[Taken]:
    """The sweeps of a folder of the shared data; none if it is absent."""
    return [_real(dict(np.load(path))) for path in sorted((DATA / name).glob("sweep_*.npz"))]


def _real(arrays: dict[str, NDArray[Any]]) -> Taken:
    xyz = np.ascontiguousarray(arrays["xyz"], np.float32)
    sweep = Sweep(xyz, int(arrays["stamp_ns"]), "lidar", times_s=arrays.get("time_offset"))
    static = np.linalg.norm(xyz, axis=1) > _OWN_CAR_M
    if "is_dynamic" in arrays:
        # Movers are labelled only in view of the camera.
        static &= arrays["flow_valid"] & arrays["label_valid"] & ~arrays["is_dynamic"]
    above_ground = ~arrays.get("is_ground", np.zeros(len(xyz), bool))
    pose = arrays["pose"]
    return Taken(sweep, lambda _: pose, static, above_ground, is_continuous=False)


def _frozen(case: Case) -> Iterator[Drive]:
    """The last cloud again and again, with new stamps."""
    place = Place(case, duration_s=16.0)
    before = place.taken(range(_BEFORE))
    for frozen_s in _FROZEN_S:
        end = _BEFORE + round(frozen_s * _RATE_HZ)
        frozen = [_seen_by(before[-1], place.take(number)) for number in range(_BEFORE, end)]
        after = place.taken(range(end, end + _AFTER))
        yield Drive(f"{frozen_s:g} s", [*before, *frozen, *after], end)


def _seen_by(cloud: Taken, at: Taken) -> Taken:
    """The points of a sweep at the time and place of another one."""
    sweep = replace(cloud.sweep, stamp_ns=at.sweep.stamp_ns)
    return replace(cloud, sweep=sweep, pose_at=at.pose_at)


def _standing_starts(case: Case) -> Iterator[Drive]:
    """The sensor stands, then drives off; it measures in the same directions, or in others."""
    end = round(_STARTED_S * _RATE_HZ)
    for directions in ("fixed", "changing"):
        change = _unchanged if case.place == "carried" else _without_sway
        place = Place(case, change, stands_s=_STANDS_S, directions=directions)
        yield Drive(f"{directions} directions", place.taken(range(end + _AFTER)), end)


def _without_sway(scene: Scene) -> Scene:
    """The scene with a sensor that stands still where it stands."""
    return replace(scene, ego=replace(scene.ego, sway=np.zeros((3, 3))))


def _thrown(case: Case, variant: str, lasts_s: float, **changes: float) -> Drive:
    """The sensor is turned to the left, or pushed to the left and back, for a while."""
    begin_s = _BEFORE / _RATE_HZ

    def change(scene: Scene) -> Scene:
        ego = Thrown.of(scene.ego, begin_s=begin_s, end_s=begin_s + lasts_s, **changes)
        return replace(scene, ego=ego)

    end = _BEFORE + round(lasts_s * _RATE_HZ)
    return Drive(variant, Place(case, change).taken(range(end + _AFTER)), end)


def _turns(case: Case) -> Iterator[Drive]:
    for turn_deg in _TURNS_DEG:
        yield _thrown(case, f"{turn_deg:g}° a sweep", _TURN_S, turn_deg_s=turn_deg * _RATE_HZ)


def _pushes(case: Case) -> Iterator[Drive]:
    for push_m_s in _PUSHES_M_S:
        yield _thrown(case, f"{push_m_s:g} m/s", _PUSH_S, push_m_s=push_m_s)


def _covers(case: Case) -> Iterator[Drive]:
    """The lidar is covered, carried on and turned, and uncovered."""
    for covered_s in _COVERED_S:
        turn_deg_s = _COVER_TURN_DEG / covered_s
        drive = _thrown(case, f"{covered_s:g} s", covered_s, turn_deg_s=turn_deg_s)
        assert drive.end is not None  # noqa: S101 - see `_thrown`
        rng = np.random.default_rng(case.seed)
        sweeps = [
            _covered(each, rng) if _BEFORE <= number < drive.end else each
            for number, each in enumerate(drive.sweeps)
        ]
        yield replace(drive, sweeps=sweeps)


def _covered(taken: Taken, rng: np.random.Generator) -> Taken:
    """The points on a cover, of which no motion is true."""
    directions = rng.normal(size=(_COVER_POINTS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges_m = _COVER_M + rng.normal(0.0, 0.01, (_COVER_POINTS, 1))
    xyz = (directions * ranges_m).astype(np.float32)
    times_s = taken.sweep.times_s
    if times_s is not None:
        times_s = np.linspace(*taken.sweep.span_s, _COVER_POINTS, dtype=np.float32)
    sweep = replace(taken.sweep, xyz=xyz, times_s=times_s)
    none = np.zeros(_COVER_POINTS, bool)
    return replace(taken, sweep=sweep, static=none, above_ground=~none)


def _rates(case: Case) -> Iterator[Drive]:
    """Nothing but another number of sweeps in a second."""
    for rate_hz in _RATES_HZ:
        number = _BEFORE + _AFTER if rate_hz > _RATES_HZ[0] else _AFTER
        place = Place(case, duration_s=max(number / rate_hz, 10.0), rate_hz=rate_hz)
        yield Drive(f"{rate_hz:g} Hz", place.taken(range(number)), None, rate_hz)


def _buses(case: Case) -> Iterator[Drive]:
    """A bus overtakes closely."""
    for faster_m_s in _BUSES_M_S:
        change = partial(_with_bus, speed_m_s=case.speed_m_s + faster_m_s, seed=case.seed)
        ends_s = _BEFORE / _RATE_HZ + 2 * _BUS_GONE_M / faster_m_s
        end = round(ends_s * _RATE_HZ)
        place = Place(case, change, duration_s=ends_s + _AFTER / _RATE_HZ)
        variant = f"{faster_m_s:g} m/s faster"
        yield Drive(variant, place.taken(range(end + _AFTER)), end)


def _with_bus(scene: Scene, speed_m_s: float, seed: int) -> Scene:
    """The scene with a bus that comes from behind, on the left."""
    lane = scene.street.lane(_BUS_BESIDE_M - LANE_LATERAL_M, forward=True)
    begin_s = _BEFORE / _RATE_HZ
    x, y = scene.ego.trip.pose(begin_s)[:2, 3]
    at_m = lane.arc_nearest(x, y) - _BUS_GONE_M - speed_m_s * begin_s
    trip = Trip.starting_at(lane, SpeedProfile.steady(speed_m_s), at_m)
    bus = Body(models.coach(np.random.default_rng(seed)), trip)
    return replace(scene, bodies=(*scene.bodies, bus))


def _doors(case: Case) -> Iterator[Drive]:
    """A door closes in front of a sensor that stands."""
    begin_s = _BEFORE / _RATE_HZ
    for speed_m_s in _DOORS_M_S:
        arc_m = math.pi / 2 * _DOOR_M / 2
        end = _BEFORE + math.ceil((arc_m / speed_m_s + 0.4) * _RATE_HZ)
        change = partial(_with_door, begin_s=begin_s, speed_m_s=speed_m_s)
        place = Place(case, change, stands_s=60.0)
        yield Drive(f"{speed_m_s:g} m/s", place.taken(range(end + _AFTER)), end)


def _with_door(scene: Scene, begin_s: float, speed_m_s: float) -> Scene:
    """The scene with a wall ahead whose doorway is closed."""
    x, y, _ = scene.ego.trip.planar(np.zeros(1))[0] + (_DOOR_AHEAD_M, 0.0, 0.0)
    right, left, thick = y - _DOOR_M / 2, y + _DOOR_M / 2, (x - 0.05, x + 0.05)
    walls = (
        box(thick, (left, left + 20.0), (0.0, 6.0)),
        box(thick, (right - 20.0, right), (0.0, 6.0)),
        box(thick, (right, left), (_DOORWAY_M, 6.0)),
    )
    leaf = (box((-0.03, 0.03), (-_DOOR_M / 2, _DOOR_M / 2), (0.0, _DOORWAY_M)),)
    # The door turns about its left edge; open, it leads away from the sensor.
    angles = np.linspace(0.0, -math.pi / 2, 40)
    middle = np.stack([x + _DOOR_M / 2 * np.cos(angles), left + _DOOR_M / 2 * np.sin(angles)], 1)
    trip = walk(Route.through(middle), begin_s, speed_m_s)
    wall = Body(Model(SurfaceClass.BUILDING, walls, 0.1, 40.0, 90.0), np.eye(4))
    door = Body(Model(SurfaceClass.BUILDING, leaf, 0.06, _DOOR_M, 60.0), trip)
    return replace(scene, bodies=(*scene.bodies, wall, door))


@dataclass(frozen=True)
class Thrown(SensorTrip):
    """A trip on which the sensor is turned to the left, or pushed there and back, for a while."""

    begin_s: float = 0.0
    end_s: float = 0.0
    turn_deg_s: float = 0.0
    push_m_s: float = 0.0

    @classmethod
    def of(cls, trip: SensorTrip, **changes: float) -> "Thrown":
        """Returns a trip with changes."""
        return cls(**vars(trip), **changes)

    def world_from_sensor(self, time_s: float) -> NDArray[Any]:
        """Returns the (4, 4) pose of the lidar frame at a time."""
        whole_s = self.end_s - self.begin_s
        passed_s = min(max(time_s - self.begin_s, 0.0), whole_s)
        turned = math.radians(self.turn_deg_s) * passed_s
        pushed_m = self.push_m_s * min(passed_s, whole_s - passed_s)
        return super().world_from_sensor(time_s) @ planar_pose(0.0, pushed_m, turned)


DISTURBANCES: Final[dict[str, Callable[[Case], Iterator[Drive]]]] = {
    "gap": _gaps,
    "frozen": _frozen,
    "start": _standing_starts,
    "turn": _turns,
    "push": _pushes,
    "rate": _rates,
    "bus": _buses,
    "cover": _covers,
    "door": _doors,
}
# Where it matters that points have times of their own; those take long to simulate.
_OF_MOTION: Final = ("gap", "start", "turn", "push")
_ONLY_IN: Final = {"bus": ("street",), "door": ("rooms",)}
