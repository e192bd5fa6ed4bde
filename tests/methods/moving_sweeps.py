# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps whose flow is known, and settings that make every method fast."""

import numpy as np

from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

TRANSLATION = (0.3, -0.2, 0.05)

# Small networks, enough steps, steps that fade out, and no clock that decides anything.
QUICK = preset("paper").changed(
    {
        "compute.device": "cpu",
        "compute.num_threads": 1,
        "ground.remove": False,
        "distance.kind": "tree",
        "field.num_hidden_layers": 3,
        "field.hidden_width": 32,
        "fusion.hidden_width": 16,
        "optimization.decay": True,
        "optimization.max_iterations": 100,
        "fusion.max_iterations": 60,
        "early_stopping.patience": 0,
        "fusion.patience": 0,
        "nsfp.patience": 0,
        "nsfp.truncation_m": 5.0,  # so small a network starts with flows of more than 1.4 m
        "linear.node_spacing_m": 5.0,
        "linear.sigma_m": 10.0,
    }
)


def as_sweep(xyz, number=0):
    """A sweep of the series that has one every 0.1 s."""
    return Sweep.from_array(xyz, stamp_ns=10_000_000_000 + number * 100_000_000)


def triplet_of(scene):
    """The three sweeps of a scene."""
    return SweepTriplet(
        as_sweep(scene.previous, -1), as_sweep(scene.current), as_sweep(scene.next, 1)
    )


def moving_triplet(places, translation=TRANSLATION):
    """Four sweeps before and one after: everything moves by a translation in each interval."""

    def at(number):
        moved = places + number * np.asarray(translation)
        return as_sweep(np.random.default_rng(9 + number).permutation(moved), number)

    next_from_current = np.eye(4)
    next_from_current[:3, 3] = translation
    return SweepTriplet(
        previous=at(-1),
        current=as_sweep(places),
        next=at(1),
        earlier=(at(-2), at(-3)),
        next_from_current=next_from_current,
    )


def mean_error(flow, truth=TRANSLATION):
    """Mean length of the difference, metres."""
    return float(np.linalg.norm(flow - np.asarray(truth), axis=1).mean())
