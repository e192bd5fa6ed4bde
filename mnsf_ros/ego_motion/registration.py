# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration of each sweep with those before it, which doubts what it finds.

A map of the last sweeps gives the exact pose, but it confirms its own errors: a sweep that was
added at a wrong pose holds the next ones there. So each pose is shown to witnesses, the separate
pieces of the scene in the last sweep and in one a second ago. If more of them than usual
contradict, the pose competes with others: by the last sweep alone from the expected motion, from
standing still, and from anywhere. If no motion clearly wins, the sensor is lost.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.deskewed_match import Match, SweepPair, matched
from mnsf_ros.ego_motion.deskewing import Deskewing
from mnsf_ros.ego_motion.pieces import Testimony, angle_of
from mnsf_ros.ego_motion.sweep_matcher import Placed, SweepMatcher
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.geometry.transforms import interpolated_pose, planar_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.azimuth_step import azimuth_step
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# An earlier sweep is a witness as long as it shows nearly the same view.
_MAX_AGE_S: Final = 1.0
_NEAR_M: Final = 1.0
_NEAR_RAD: Final = 0.2
# Share of the pieces that contradict a right motion, as they move: median .00 to .07 in 20 random
# and adverse worlds, .15 at most. A wrong motion is contradicted by .25 and more.
_USUAL_SHARE: Final = 0.05
_RISE: Final = 0.1
_GAIN: Final = 0.2
_GAIN_IN_DOUBT: Final = 0.05
# Standard deviations between the numbers of pieces that contradict two motions, among several and
# between two: with less, chance moves a sensor that stands among few pieces.
_CLEARLY: Final = 3.0
_RATHER: Final = 2.0
# How far, in a second, the pose of a sensor is off that started without being noticed.
_SHIFTS_M: Final = np.linspace(-2.0, 2.0, 17)
# Of the best of these.
_NEARBY: Final = np.diag(np.square([0.15] * 3 + [0.02] * 3))
# Motions are other ones if they move a point that is far away by more than this.
_FAR_M: Final = 20.0
_OTHER_M: Final = 0.3


class Lost(NamedTuple):
    """A sweep whose pose is not known.

    Attributes:
        reason: Why.
        best: (4, 4) last_from_sweep that explains most; None if nothing is found.
        again: Its pose by an earlier sweep, to go on with; None if that is not known either.
    """

    reason: str
    best: Floats | None = None
    again: "FoundAgain | None" = None


class FoundAgain(NamedTuple):
    """A sweep registered with an earlier one than the last.

    Attributes:
        pose: (4, 4) its pose.
        step: (4, 4) that the next step is expected to equal.
        cloud: Its points for the map.
        map: That of the earlier sweep alone.
    """

    pose: Floats
    step: Floats
    cloud: Cloud
    map: SweepMatcher


class _Witness(NamedTuple):
    """An earlier sweep at its pose."""

    stamp_ns: int
    pose: Floats
    cloud: Cloud | None

    def is_near(self, stamp_ns: int, pose: Floats) -> bool:
        """Whether the view from a pose (4, 4) at a time is nearly the same."""
        off = np.linalg.inv(self.pose) @ pose
        is_young = 0 < stamp_ns - self.stamp_ns <= _MAX_AGE_S * NANOSECONDS
        return bool(is_young and np.linalg.norm(off[:3, 3]) < _NEAR_M and angle_of(off) < _NEAR_RAD)

    def testimony(self, match: Match, pose: Floats) -> Testimony:
        """What the pieces of a match, at a pose (4, 4), say against this sweep."""
        return Testimony.of(match.pieces, np.linalg.inv(self.pose) @ pose, self.cloud)


class Registration:
    """Finds the pose of each sweep by those before it."""

    def __init__(self, settings: EgoMotionSettings, deskewing: Deskewing) -> None:
        self._settings, self._deskewing = settings, deskewing
        self._map: SweepMatcher | None = None  # includes the last sweep
        self._witnesses: deque[_Witness] = deque()
        self._usual_share = _USUAL_SHARE
        self._azimuth_step_rad = math.nan  # of the first sweep

    def start(self, sweep: Sweep, pose: Floats) -> None:
        """Begins with a sweep at a pose (4, 4), and forgets those before it.

        A sweep with too few points does not replace an earlier one.
        """
        if math.isnan(self._azimuth_step_rad):
            self._azimuth_step_rad = azimuth_step(turned(sweep.xyz, sweep.beams_from_sensor))
        matcher = SweepMatcher(self._settings)
        cloud = matcher.prepared(sweep, self._deskewing.motion_in(sweep))
        if cloud is None and self._map is not None:
            return
        matcher.add(cloud, Placed(pose))
        self._map = matcher
        self._witnesses.clear()
        self._remember(sweep)

    def start_again(self, sweep: Sweep, again: FoundAgain) -> None:
        """Goes on with an earlier sweep and the newest one, and forgets those between."""
        self._map = again.map
        self._map.add(again.cloud, Placed(again.pose))
        self._witnesses.clear()
        self._remember(sweep)

    def stop(self) -> None:
        """Forgets all sweeps, as they are not needed."""
        self._map = None

    @property
    def is_started(self) -> bool:
        """Whether there are sweeps to register with."""
        return self._map is not None

    def find(self, pair: SweepPair) -> Match | Lost:
        """Returns the pose of a sweep that is believed, or why there is none."""
        match = self._matched(self._map, pair)
        if match is not None and not self._is_doubtful(match.testimony):
            return self._without_drift(match, pair)
        winner = self._winner(match, pair)
        return self._without_drift(winner, pair) if isinstance(winner, Match) else winner

    def accept(self, match: Match, sweep: Sweep) -> None:
        """Adds a sweep to the map at the pose that was found."""
        self._usual_share += _GAIN * (match.testimony.share - self._usual_share)
        if match.map is not self._map:
            # The last sweep is in it as it is known by now.
            self._witnesses.clear()
        self._map = match.map
        self._map.add(match.cloud, match.found)
        self._remember(sweep)

    def _remember(self, sweep: Sweep) -> None:
        if self._map is not None:
            witness = _Witness(sweep.stamp_ns, self._map.last_pose, self._map.last_cloud)
            self._witnesses.append(witness)
        oldest_ns = sweep.stamp_ns - _MAX_AGE_S * NANOSECONDS
        while self._witnesses and self._witnesses[0].stamp_ns < oldest_ns:
            self._witnesses.popleft()

    def _is_doubtful(self, testimony: Testimony) -> bool:
        """Whether more pieces than usual contradict a motion."""
        return testimony.share > max(self._usual_share, _USUAL_SHARE) + _RISE

    def _winner(self, match: Match | None, pair: SweepPair) -> Match | Lost:
        """The motion that fewest pieces of the last sweep contradict, if it clearly wins."""
        found = [*([] if match is None else [match]), *self._by_last_sweep(pair)]
        if not found:
            return Lost("the sweep does not match those before it")
        best = min(found, key=lambda each: each.testimony.num_against)
        others = [each for each in found if _are_others(best.found.pose, each.found.pose)]
        if not all(each.testimony.contradicts_more(best.testimony, _CLEARLY) for each in others):
            return Lost("several motions explain what the sensor sees", best.motion)
        if self._is_doubtful(best.testimony):
            # Or there is always as little in common, as in noise.
            self._usual_share += _GAIN_IN_DOUBT * (best.testimony.share - self._usual_share)
            return Lost("no motion of the sensor explains most of what it sees", best.motion)
        # Of nearly the same poses that of the map is the most exact one.
        first = next(each for each in found if each not in others)
        return first if first.map is self._map else self._by_map(first, pair)

    def _by_last_sweep(self, pair: SweepPair) -> Iterator[Match]:
        """Yields poses by the last sweep alone: as expected, standing still, from anywhere."""
        if self._map is None or self._map.last_cloud is None:
            return
        alone = self._map_of(self._map.last_cloud, self._map.last_pose)
        expected = [] if pair.expected is None else [pair.expected]
        for start in (*expected, Placed(pair.world_from_last), None):
            match = self._matched(alone, replace(pair, expected=start))
            if match is not None:
                yield match

    def _by_map(self, winner: Match, pair: SweepPair) -> Match:
        """The winner by the map of all sweeps, if that finds the same pose from there."""
        expected = replace(winner.found, velocity=np.zeros(6))
        match = self._matched(self._map, replace(pair, expected=expected))
        is_same = match is not None and not _are_others(winner.found.pose, match.found.pose)
        return match if match is not None and is_same else winner

    def _without_drift(self, match: Match, pair: SweepPair) -> Match | Lost:
        """The match, unless an earlier sweep shows that the poses since then are wrong.

        What stays with the sensor holds the pose of a sensor that starts slowly: a fixed grid of
        directions is the same on a wall along the way. It is left behind only after some time.
        """
        stamp_ns, pose = pair.sweep.stamp_ns, match.found.pose
        witness = next((one for one in self._witnesses if one.is_near(stamp_ns, pose)), None)
        if witness is None or witness is self._witnesses[-1] or witness.cloud is None:
            return match
        testimony = witness.testimony(match, pose)
        if not self._is_doubtful(testimony):
            return match
        alone = self._map_of(witness.cloud, witness.pose)
        # Pieces tell more than the surfaces of a single sweep, which only make the pose exact.
        other = min(_around(pose), key=lambda each: witness.testimony(match, each).num_against)
        if not testimony.contradicts_more(witness.testimony(match, other), _RATHER):
            return match
        exact = alone.match(match.cloud, Placed(other, _NEARBY))
        if exact is not None and not _are_others(other, exact.pose):
            other = exact.pose
        share = pair.interval_ns / (stamp_ns - witness.stamp_ns)
        step = interpolated_pose(np.eye(4), np.linalg.inv(witness.pose) @ other, share)
        again = FoundAgain(other, step, match.cloud, alone)
        return Lost("the last steps do not add up to what an earlier sweep shows", again=again)

    def _map_of(self, cloud: Cloud, pose: Floats) -> SweepMatcher:
        matcher = SweepMatcher(self._settings)
        matcher.add(cloud, Placed(pose))
        return matcher

    def _matched(self, map_: SweepMatcher | None, pair: SweepPair) -> Match | None:
        if map_ is None:
            return None
        return matched(map_, pair, self._deskewing, self._settings, self._azimuth_step_rad)


def _around(pose: Floats) -> Iterator[Floats]:
    """Yields poses (4, 4) beside a pose, on a grid."""
    for x, y in product(_SHIFTS_M, _SHIFTS_M):
        yield pose @ planar_pose(x, y, 0.0)


def _are_others(first: AnyFloats, second: AnyFloats) -> bool:
    """Whether two poses (4, 4) are different ones, not the same within errors."""
    off = np.linalg.inv(first) @ second
    return bool(np.linalg.norm(off[:3, 3]) + _FAR_M * angle_of(off) > _OTHER_M)
