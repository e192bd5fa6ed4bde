"""Which objects may move, and which of them do."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.settings import ObjectSettings

# An object that fits both neighbouring sweeps, and the past, without motion is not a suspect.
_MIN_EACH_M: Final = 0.015
_MIN_MEAN_M: Final = 0.025
_MIN_PAST_M: Final = 0.08
# A motion is accepted if it improves the fit and is long enough,
_MIN_GAIN_M: Final = 0.01
_MIN_MOTION_M: Final = 0.05
# if it explains the object well,
_MAX_COST_M: Final = 0.175
# also in the past, unless other sweeps saw through the place where the object is now,
_MAX_PAST_SHARE: Final = 0.6
_MIN_SEEN_THROUGH: Final = 0.2
# by this factor more clearly without such evidence,
_WITHOUT_EVIDENCE: Final = 0.7
# and if it is nearly horizontal.
_MAX_CLIMB_M: Final = 0.25


def suspects(objects: ObjectPoints, targets: Targets) -> tuple[ObjectPoints, JudgedMotions]:
    """Returns the objects that no other sweep supports as static, with their residuals.

    A surface that one neighbouring sweep does not show may be hidden; one that neither shows,
    nor the past, was not there.
    """
    # The past first: it decides most objects, and few remain for the other sweeps.
    unexplained: list[NDArray[np.float64]] = []
    for target in (*targets.past, *targets.near):
        least_m = _MIN_EACH_M if target in targets.near else _MIN_PAST_M
        column = target.unexplained(objects)
        is_suspect = column > least_m
        unexplained = [before[is_suspect] for before in (*unexplained, column)]
        objects = objects.only(is_suspect)
    columns = np.stack(unexplained, axis=1)
    num_past = len(targets.past)
    no_motion = np.zeros((len(objects), 3), np.float32)
    standing = JudgedMotions(
        no_motion, columns[:, num_past:], columns[:, :num_past], no_motion[:, 0]
    )
    is_suspect = standing.cost > _MIN_MEAN_M
    return objects.only(is_suspect), standing.only(is_suspect)


def seen_through(
    objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Returns (K,) evidence of motion: the part of each object in free space of other sweeps.

    This is the share of its points there if it is static, summed over the sweeps, less the same
    if it moves by `motions` (K, 3), in metres to the next sweep. The place of a static object may
    have been hidden, but is never free.
    """
    shares = np.zeros(len(objects))
    for target in (*targets.near, *targets.past):
        shares += target.seen_through(objects) - target.seen_through(objects, motions)
    return shares


def moves(
    standing: JudgedMotions,
    moving: JudgedMotions,
    free: NDArray[np.float64],
    settings: ObjectSettings,
) -> NDArray[np.bool_]:
    """Returns (K,) whether motion explains an object clearly better than being static does.

    Args:
        standing: How well K objects are explained as static.
        moving: How well their motions explain them.
        free: (K,) evidence of motion from free space, see `seen_through`.
        settings: Settings of the objects.
    """
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    has_evidence = free > _MIN_SEEN_THROUGH
    least = np.where(has_evidence, 1.0, _WITHOUT_EVIDENCE)
    is_clear = moving.cost < settings.max_unexplained * least * standing.cost
    is_clear &= standing.cost - moving.cost > _MIN_GAIN_M
    is_clear &= (lengths > _MIN_MOTION_M) & (moving.cost < _MAX_COST_M)
    is_clear &= np.abs(moving.motions[:, 2]) < _MAX_CLIMB_M
    max_past_share = _WITHOUT_EVIDENCE * _MAX_PAST_SHARE
    is_clear &= has_evidence | (moving.past < max_past_share * standing.past).all(axis=1)
    return is_clear
