# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The whole method on a small street whose flow is known."""

import numpy as np
import pytest

from mnsf_ros.errors import OptimizationError
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

# As published but for the end: a number of iterations, and no time budget, whose outcome depends on
# the machine. With the patience of the paper, a field of two sweeps may stop once it has found what
# stands still.
FIXED = preset("paper").changed(
    {
        "compute.device": "cpu",
        "distance.kind": "tree",
        "distance.truncation_m": 2.0,
        "early_stopping.patience": 0,
        "fusion.patience": 0,
        "optimization.learning_rate": 0.008,
        "optimization.decay": True,
        "optimization.max_iterations": 150,
        "fusion.max_iterations": 100,
    }
)
SHORT = FIXED.changed(
    {
        "field.num_hidden_layers": 2,
        "field.hidden_width": 16,
        "fusion.num_hidden_layers": 1,
        "fusion.hidden_width": 16,
        "optimization.max_iterations": 10,
        "fusion.max_iterations": 10,
    }
)


def triplet_of(scene, stamps_ms=(0, 100, 200)):
    return SweepTriplet(
        *(
            None if xyz is None else Sweep.from_array(xyz, stamp_ns=stamp * 1_000_000)
            for xyz, stamp in zip(
                (scene.previous, scene.current, scene.next), stamps_ms, strict=True
            )
        )
    )


def pair_of(triplet):
    return SweepTriplet(None, triplet.current, triplet.next)


def estimate(triplet, settings=SHORT):
    return make_method("mnsf", settings).estimate(triplet)


def mean_errors(flow, scene):
    """Mean end point error of what moves, and of what stands still, metres."""
    error = np.linalg.norm(flow - scene.flow, axis=1)
    return error[scene.moving].mean(), error[~scene.moving].mean()


@pytest.fixture
def scene(make_scene):
    return make_scene()


@pytest.fixture
def triplet(scene):
    return triplet_of(scene)


@pytest.mark.parametrize(
    ("settings", "num_sweeps"),
    [(FIXED, 2), (FIXED, 3), (preset("paper"), 3)],
    ids=["fixed-2", "fixed-3", "paper-3"],
)
def test_finds_the_flow(scene, triplet, device, settings, num_sweeps):
    given = triplet if num_sweeps == 3 else pair_of(triplet)
    result = estimate(given, settings.changed({"compute.device": device.type}))
    moving, still = mean_errors(result.flow, scene)
    # The moving box moves 0.54 m.
    assert moving < 0.1
    assert still < (0.1 if num_sweeps == 3 else 0.15)
    assert list(result.fits) == ["forward", "backward", "fusion"][: 2 * num_sweeps - 3]
    assert result.device == device.type
    assert result.distance_kind == settings.distance.kind


def test_unequal_intervals(make_scene):
    # The next sweep is two intervals away: what moved 0.3 m before moves 0.6 m now.
    scene = make_scene(motion=(0.6, 0, 0))
    half = make_scene(motion=(0.3, 0, 0)).previous
    triplet = SweepTriplet(
        Sweep.from_array(half, stamp_ns=900),
        Sweep.from_array(scene.current, stamp_ns=1000),
        Sweep.from_array(scene.next, stamp_ns=1200),
    )
    # The mean shows the inverted backward flow as it is.
    settings = FIXED.changed({"fusion.kind": "mean"})
    assert mean_errors(estimate(triplet, settings).flow, scene)[0] < 0.1
    stampless = SweepTriplet(
        *(Sweep.from_array(each.xyz) for each in (triplet.previous, triplet.current, triplet.next))
    )
    assert mean_errors(estimate(stampless, settings).flow, scene)[0] > 0.12


# Steps of 1.0 blow up so deep a network: after the second step its flow is no float32.
EXPLOSIVE = SHORT.changed(
    {
        "optimization.learning_rate": 1,
        "optimization.decay": False,
        # The best weights would be finite.
        "fusion.fields": "last",
        "field.num_hidden_layers": 30,
        "field.hidden_width": 64,
    }
)


@pytest.mark.parametrize(
    ("max_iterations", "text"),
    [
        # The loss of the second step was still a number.
        (2, "^the forward flow is not finite; try a smaller learning rate$"),
        (10, "^the loss became nan, expected a finite number of metres$"),
    ],
)
def test_no_finite_flow_is_an_error_that_leaves_nothing_behind(triplet, max_iterations, text):
    estimator = make_method(
        "mnsf", EXPLOSIVE.changed({"optimization.max_iterations": max_iterations})
    )
    with pytest.raises(OptimizationError, match=text):
        estimator.estimate(triplet)
    result = estimator.renewed(SHORT).estimate(triplet)
    np.testing.assert_array_equal(result.flow, estimate(triplet).flow)
