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
# also in the past,
_MAX_PAST_SHARE: Final = 0.6
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


def moves(
    standing: JudgedMotions, moving: JudgedMotions, settings: ObjectSettings
) -> NDArray[np.bool_]:
    """Returns (K,) whether motion explains an object clearly better than being static does."""
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    is_clear = moving.cost < settings.max_unexplained * standing.cost
    is_clear &= standing.cost - moving.cost > _MIN_GAIN_M
    is_clear &= (lengths > _MIN_MOTION_M) & (moving.cost < _MAX_COST_M)
    is_clear &= np.abs(moving.motions[:, 2]) < _MAX_CLIMB_M
    is_clear &= (moving.past < _MAX_PAST_SHARE * standing.past).all(axis=1)
    return is_clear
