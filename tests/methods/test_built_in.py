# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every built-in method on sweeps whose flow is known; ablations do what their names say."""

from dataclasses import replace

import numpy as np
import pytest
from moving_sweeps import QUICK, as_sweep, mean_error, moving_triplet, triplet_of

from mnsf_ros.errors import CancelledError, SweepError
from mnsf_ros.methods import make_method, method_names
from mnsf_ros.networks.optimization import StopReason
from mnsf_ros.sweeps.sweep import SweepTriplet

NETWORKS = ("flot", "3dflow", "gmsf", "scoop")
OPTIMIZING = [name for name in method_names() if name not in ("zero", "ego", *NETWORKS)]
REGISTERING = ("online", "ego-estimated")
COLD = ["nsfp", "nsfp-linear", "fnsf", "fnsf-linear", "fnsf-joint", "fnsf-time", "mnsf-cycle"]
TWO_SWEEPS = [
    *("ego-estimated", "nsfp", "nsfp-linear", "fnsf", "fnsf-linear", "mnsf-no-backward"),
]

SHORT = QUICK.changed({"optimization.max_iterations": 4, "fusion.max_iterations": 4})


def estimate(name, triplet, settings=QUICK):
    return make_method(name, settings).estimate(triplet)


def median_error(flow, truth):
    return float(np.median(np.linalg.norm(flow - truth, axis=1)))


@pytest.mark.parametrize("name", OPTIMIZING)
def test_finds_the_translation(translated, make_scene, name):
    if name in REGISTERING:  # registration needs surfaces, which take some points
        translated = moving_triplet(make_scene(points_per_box=80).current)
    result = estimate(name, translated)
    assert result.flow.shape == translated.current.xyz.shape
    assert result.flow.dtype == np.float32
    # |translation| is 0.36 m. NSFP's squared distances leave small errors alone the longest.
    assert mean_error(result.flow) < (0.15 if name.startswith("nsfp") else 0.04)
    assert result.kept.all()
    assert {fit.stop_reason for fit in result.fits.values()} <= {
        StopReason.ITERATION_LIMIT,
        StopReason.CONVERGED,
    }


@pytest.mark.parametrize("name", COLD)
def test_finds_what_moves_in_a_world_that_stands(make_scene, name):
    scene = make_scene()
    settings = QUICK.changed(
        {
            "ground.remove": True,
            "field.num_hidden_layers": 8,
            "field.hidden_width": 64,
            "fusion.hidden_width": 64,
            "optimization.learning_rate": 0.004,
            "optimization.max_iterations": 150,
            "nsfp.learning_rate": 0.004,
            "linear.node_spacing_m": 2,
            "linear.sigma_m": 2,
        }
    )
    flow = estimate(name, triplet_of(scene), settings).flow
    errors = np.linalg.norm(flow - scene.flow, axis=1)
    # The box moves 0.54 m.
    assert errors[scene.moving].mean() < 0.2
    assert errors[~scene.moving].mean() < 0.1


@pytest.mark.parametrize("name", [*COLD, "mnsf"])
def test_same_seed_same_bits_whatever_came_before(translated, name):
    estimator = make_method(name, SHORT)
    first = estimator.estimate(translated).flow
    estimator.estimate(moving_triplet(translated.current.xyz, (0.0, 0.1, 0.0)))
    np.testing.assert_array_equal(estimator.estimate(translated).flow, first)
    other = estimate(name, translated, SHORT.changed({"compute.seed": 1}))
    assert not np.array_equal(other.flow, first)


@pytest.mark.parametrize("name", [*COLD, "mnsf"])
def test_cropped_points_get_a_flow_but_have_no_say(translated, name):
    outside = [(500.0, 0.0, 0.0), (0.0, 0.0, 90.0), (1e20, 0.0, -1e20)]
    more = replace(translated, current=as_sweep(np.vstack([outside, translated.current.xyz])))
    result = estimate(name, more, SHORT)
    assert result.kept.tolist() == [False] * 3 + [True] * len(translated.current)
    assert np.isfinite(result.flow).all()
    np.testing.assert_array_equal(result.flow[3:], estimate(name, translated, SHORT).flow)


@pytest.mark.parametrize("name", [*COLD, "mnsf"])
def test_cancelled(translated, name):
    answers = iter([False, False, True])
    with pytest.raises(CancelledError):
        make_method(name, SHORT).estimate(translated, lambda: next(answers))


@pytest.mark.parametrize("name", [*COLD, "mnsf"])
def test_time_budget_ends_each_stage_after_its_first_step(translated, name):
    settings = SHORT.changed({"optimization.time_budget_ms": 0.001})
    fits = estimate(name, translated, settings).fits
    assert {fit.iterations for fit in fits.values()} == {1}
    assert {fit.stop_reason for fit in fits.values()} == {StopReason.TIME_BUDGET}


@pytest.mark.parametrize("name", OPTIMIZING)
def test_says_how_many_sweeps_it_needs_and_refuses_fewer(translated, name):
    estimator = make_method(name, SHORT)
    needed = dict.fromkeys(TWO_SWEEPS, 2) | {"mnsf-frames4": 4, "mnsf-frames5": 5}
    num_sweeps = estimator.traits.num_sweeps
    assert num_sweeps == needed.get(name, 3)
    enough = replace(translated, earlier=translated.earlier[: max(0, num_sweeps - 3)])
    if num_sweeps == 2:
        enough = replace(enough, previous=None, earlier=())
    assert np.isfinite(estimator.estimate(enough).flow).all()
    # The paper's method itself makes do with two sweeps: without the previous one it is FNSF.
    if name in ("fnsf-joint", "fnsf-time", "mnsf-cycle"):
        with pytest.raises(SweepError, match=r"^sweep at 10\.000 s: got 0 sweeps before it"):
            estimator.estimate(replace(translated, previous=None, earlier=()))
    if num_sweeps > 3:
        with pytest.raises(SweepError, match=r"got 1 sweeps before it, expected"):
            estimator.estimate(replace(translated, earlier=()))


def test_zero_and_ego_are_what_they_say(translated):
    assert not estimate("zero", translated).flow.any()
    # A quarter turn to the left: what was ahead is now to the right.
    turn = np.eye(4)
    turn[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    ahead = SweepTriplet(None, as_sweep([[10.0, 0, 0]]), as_sweep([[0, -10.0, 0]]), (), turn)
    np.testing.assert_allclose(estimate("ego", ahead).flow, [[-10, -10, 0]], atol=1e-6)
    assert mean_error(estimate("ego", translated).flow) < 1e-6
    with pytest.raises(SweepError, match=r"^sweep at 10\.000 s: .*next_from_current"):
        estimate("ego", replace(translated, next_from_current=None))


@pytest.mark.parametrize("name", [*COLD, "mnsf"])
def test_every_device_gives_the_flow_of_the_cpu_with_some_of_the_points(translated, device, name):
    few = SHORT.changed({"optimization.max_points": 100})
    result = estimate(name, translated, few.changed({"compute.device": device.type}))
    assert result.device == device.type
    # Adam's first steps have the sign of the gradient, however small: rounding makes 1.1 mm.
    assert mean_error(result.flow, estimate(name, translated, few).flow) < 0.003


@pytest.mark.parametrize(
    ("name", "stages"),
    [
        ("mnsf", ["forward", "backward", "fusion"]),
        ("mnsf-no-backward", ["forward", "fusion"]),
        ("mnsf-frames4", ["forward", "backward", "backward 2", "fusion"]),
        ("mnsf-cycle", ["forward", "backward", "fusion"]),
        ("fnsf-joint", ["forward"]),
    ],
)
def test_stages(translated, name, stages):
    result = estimate(name, translated, SHORT)
    assert list(result.fits) == stages
    assert list(result.times_ms) == ["prepare", *stages]


def test_a_variant_is_the_method_with_other_settings(translated):
    changes = {"fusion.kind": "mean", "fusion.inversion": False}
    settings = SHORT.changed(changes)
    variant = make_method("mnsf+fusion.kind=mean+fusion.inversion=false", SHORT)
    assert variant.settings == settings
    assert variant.settings.explicit == settings.explicit
    expected = estimate("mnsf", translated, settings).flow
    np.testing.assert_array_equal(variant.estimate(translated).flow, expected)


def test_without_inversion_the_mean_is_of_f_and_b_itself(translated):
    # f + b and f - b add up to twice f, whatever the two are.
    plain = SHORT.changed({"fusion.kind": "mean"})
    without = estimate("mnsf+fusion.inversion=false", translated, plain).flow
    inverted = estimate("mnsf", translated, plain).flow
    forward = estimate("fnsf", translated, SHORT).flow
    np.testing.assert_allclose(without + inverted, forward, atol=1e-6)
    assert not np.allclose(without, inverted)


def test_flow_to_earlier_sweeps_is_divided_by_their_number(translated):
    mean = QUICK.changed({"fusion.kind": "mean"})
    slow = np.array([0.1, -0.05, 0.0])
    triplet = moving_triplet(translated.current.xyz, slow)
    # The middle one: a few points are drawn to a wrong neighbor.
    assert median_error(estimate("mnsf-frames5", triplet, mean).flow, slow) < 0.015
    # Twice and three times as far in twice and three times the time, and backward.
    without = estimate("mnsf-frames5", triplet, mean.changed({"fusion.inversion": False}))
    assert median_error(without.flow, slow * (1 - 1 - 2 - 3) / 4) < 0.015
