# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Splitting: new points of an object become a part that may move alone."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from mnsf_ros.arrays import Floats32, Ints
from mnsf_ros.geometry.segmentation import Segmentation
from mnsf_ros.online.object_sweep import SAME_PLACE_M, ObjectSweep
from mnsf_ros.online.target import Target


def split(current: ObjectSweep, targets: Sequence[Target]) -> ObjectSweep:
    """Returns the sweep with new points as parts of the objects that they touch.

    A point is new if another sweep saw through its place and had no point near it. It may belong
    to a pedestrian in a row of parked cars, or to the front of a bus; the gate decides.

    Args:
        current: The sweep.
        targets: Sweeps before it.
    """
    is_new = np.zeros(len(current.thinned), dtype=bool)
    for target in targets:
        is_new |= target.are_new(current.thinned)
    return _with_parts(current, np.flatnonzero(is_new & (current.thinned_objects > 0)))


def rejoined(current: ObjectSweep, movers: Ints) -> ObjectSweep:
    """Returns the sweep with parts merged into their wholes again, except movers.

    If a part of a whole moves, the other parts of this whole stay separate, too: they may be
    fragments of the mover.

    Args:
        current: The sweep.
        movers: The numbers of the objects that move.
    """
    wholes = current.wholes
    still_split = np.setdiff1d(wholes[movers], movers)
    after = np.where(np.isin(wholes, still_split), np.arange(current.num_objects), wholes)
    return current.relabelled(lambda _, object_ids: after[object_ids], wholes)


def _with_parts(current: ObjectSweep, new: Ints) -> ObjectSweep:
    """Returns the sweep with some thinned points and their surroundings as new objects.

    Args:
        current: The sweep.
        new: (P,) the points; connected ones of one object are a part of it, if the part is no more
            than half of the object. Otherwise they stay in the object.
    """
    if len(new) == 0:
        return current
    num_objects = current.num_objects
    chosen = np.take(current.thinned, new, axis=0)
    parts = Segmentation(chosen, SAME_PLACE_M)
    is_split = np.zeros(num_objects, np.bool_)
    is_split[current.thinned_objects[new]] = True

    def keys_of(points: Floats32, object_ids: Ints) -> Ints:
        return parts.objects_of(points) * num_objects + object_ids

    def apart(points: Floats32, object_ids: Ints, keys: Ints) -> Ints:
        own = np.flatnonzero(is_split[object_ids])
        wanted, changed = keys_of(np.take(points, own, axis=0), object_ids[own]), object_ids.copy()
        places = np.searchsorted(keys, wanted)
        is_part = np.append(keys, -1)[places] == wanted
        changed[own[is_part]] = places[is_part] + num_objects
        return changed

    keys = np.unique(keys_of(chosen, current.thinned_objects[new]))
    object_ids = apart(current.thinned, current.thinned_objects, keys)
    counts = np.bincount(object_ids, minlength=num_objects + len(keys))[num_objects:]
    kept_keys = keys[2 * counts <= current.counts[keys % num_objects]]
    return current.relabelled(
        partial(apart, keys=kept_keys), np.append(current.wholes, kept_keys % num_objects)
    )
