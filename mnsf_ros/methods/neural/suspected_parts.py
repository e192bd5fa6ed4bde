# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which parts of a sweep may move: those that older sweeps do not show at the same place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.methods.neural.parts import Parts
from mnsf_ros.objects.object_sweep import ObjectSweep, sizes_of
from mnsf_ros.objects.segmentation import Segmentation
from mnsf_ros.objects.target import Target

# Farther off, a wall that is seen along itself looks as if it had been seen through.
_MAX_RANGE_M: Final = 30.0
# Points that came lately are a part of their own if they are less than this share of an object
# longer than `objects.max_size_m`, or of a shorter one, from a length on.
_MAX_SHARE_OF_LONG: Final = 0.1
_MAX_SHARE: Final = 0.3
_MIN_LENGTH_M: Final = 2.0
# Of a shorter object only a part of the size of a pedestrian is cut off.
_PEDESTRIAN_M: Final = 1.2
_PART_CELL_M: Final = 0.25
# Longer objects than this many times the largest size do not move.
_MAX_SIZES: Final = 2.0
# A part moves hardly if older sweeps, the younger first, leave less residual than this without
# motion, and the one with most less than the last. Without older sweeps the mean of all counts.
_MIN_PAST_M: Final = (0.03, 0.07)
_MIN_MOST_M: Final = 0.08
_MIN_NEAR_M: Final = 0.04
# Of something long only the ends show that it moves: beyond this length less residual is enough.
LONG_M: Final = 4.0


def part_numbers(
    current: ObjectSweep, others: Sequence[Target], max_size_m: float
) -> NDArray[np.int64]:
    """Returns (T,) the part of each thinned point of a sweep; 0 for what is too long to move.

    A part is an object, or what came lately of one: where others saw through and nothing was near.

    Args:
        current: The sweep.
        others: Older sweeps, or the neighbouring ones if there are none.
        max_size_m: Size from which an object is long.
    """
    objects, sizes = current.thinned_objects, current.sizes
    is_long = sizes >= max_size_m
    rows = np.flatnonzero((sizes >= _MIN_LENGTH_M)[objects])
    places = np.take(current.thinned, rows, axis=0)
    rows = rows[(places * places).sum(axis=1) < _MAX_RANGE_M**2]
    places = np.take(current.thinned, rows, axis=0)
    is_new = np.zeros(len(rows), np.bool_)
    for other in others:
        is_new |= other.are_new(places)
    num_new = np.bincount(objects[rows[is_new]], minlength=len(sizes))
    shares = num_new / np.maximum(np.bincount(objects, minlength=len(sizes)), 1)
    is_old = shares < np.where(is_long, _MAX_SHARE_OF_LONG, _MAX_SHARE)
    may_move = ~is_long | (~is_old & (sizes < _MAX_SIZES * max_size_m))
    may_move[0] = False
    numbers = np.where(may_move[objects], objects, 0)
    cut = rows[is_new & is_old[objects[rows]]]
    if len(cut):
        points = np.take(current.thinned, cut, axis=0)
        segments = Segmentation(points, _PART_CELL_M)
        own = segments.objects_of(points)
        is_small = sizes_of(points, own, segments.num_objects)[own] < _PEDESTRIAN_M
        is_part = is_long[objects[cut]] | is_small
        numbers[cut[is_part]] = current.num_objects + own[is_part]
    return numbers


def suspected(
    parts: Parts, near: Sequence[Target], past: Sequence[Target], is_expected: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Returns a (K,) mask of the parts that may move, those that were expected among them.

    Args:
        parts: K parts.
        near: The neighbouring sweeps.
        past: Older sweeps, the younger first.
        is_expected: (K,) the parts of which a motion is expected.
    """
    shares = long_shares(parts)
    may_move, no_motion = np.ones(len(parts), np.bool_), np.zeros((len(parts), 3), np.float32)
    most_m = np.zeros(len(parts))
    # The oldest decides most parts: few remain for the other.
    for target, least_m in [*zip(past, _MIN_PAST_M, strict=False)][::-1]:
        left = parts.only(may_move).residuals(target, no_motion[may_move])
        most_m[may_move] = np.maximum(most_m[may_move], left)
        may_move[may_move] = left > (least_m * shares)[may_move]
        may_move |= is_expected
    if past:
        return may_move & (is_expected | (most_m > _MIN_MOST_M * shares))
    near_m = np.mean([parts.residuals(target, no_motion) for target in near], axis=0)
    return np.asarray(is_expected | (near_m > _MIN_NEAR_M), np.bool_)


def long_shares(parts: Parts) -> NDArray[np.float64]:
    """Returns (K,) shares of evidence that suffice for parts by their length, at most 1."""
    lengths = parts.extents[:, :2].max(axis=1, initial=LONG_M)
    return np.asarray(LONG_M / lengths, np.float64)
