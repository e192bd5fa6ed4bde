# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The array API: what comes in, what comes out, what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mnsf_ros.errors import MnsfError, OptimizationError, SettingsError, SweepError
from mnsf_ros.presets import preset
from mnsf_ros.scene_flow import StepReport, estimate_flow
from mnsf_ros.settings import Settings

SHORT = Settings().changed(
    {
        "compute.device": "cpu",
        "method.name": "mnsf",
        "field.num_hidden_layers": 2,
        "field.hidden_width": 16,
        "optimization.max_iterations": 5,
        "optimization.time_budget_ms": 0,
        "warm_start.time_budget_ms": 0,
        "fusion.max_iterations": 5,
    }
)


KINDS = {"network": SHORT, "objects": Settings().changed({"compute.device": "cpu"})}


@pytest.fixture
def scene(make_scene):
    return make_scene()


@pytest.fixture(params=KINDS)
def settings(request):
    """Those of either kind of field."""
    return KINDS[request.param]


def estimate(scene, settings=SHORT):
    return estimate_flow(scene.current, scene.next, scene.previous, settings)


def test_flow_leads_from_current_to_next(scene):
    result = estimate_flow(scene.current, scene.next, scene.previous, "paper")
    error = np.linalg.norm(result.flow - scene.flow, axis=1)
    assert error[scene.moving].mean() < 0.1
    assert error.mean() < 0.1


def test_order_of_the_arguments(make_scene):
    # What comes is the opposite of what goes.
    scene = make_scene(motion=(0.5, 0, 0))
    back = estimate_flow(scene.current, scene.previous, scene.next, "paper")
    np.testing.assert_allclose(back.flow[scene.moving].mean(axis=0), (-0.5, 0, 0), atol=0.1)


def test_presets_have_names_and_the_fast_one_is_the_default(scene):
    default = estimate_flow(scene.current, scene.next, scene.previous)
    assert default.over_ground is not None
    for settings in ("online", preset("online")):
        again = estimate_flow(scene.current, scene.next, scene.previous, settings)
        np.testing.assert_array_equal(default.flow, again.flow)
    by_name = estimate_flow(scene.current, scene.next, settings="paper")
    paper = estimate_flow(scene.current, scene.next, settings=preset("paper"))
    assert by_name.distance_kind == "grid"
    np.testing.assert_array_equal(by_name.flow, paper.flow)
    with pytest.raises(SettingsError, match="unknown preset 'slow', expected one of online"):
        estimate_flow(scene.current, scene.next, settings="slow")


def test_long_estimate_says_how_far_it_is(scene):
    lines = []
    quiet = estimate_flow(scene.current, scene.next, settings=SHORT)
    result = estimate_flow(scene.current, scene.next, settings=SHORT, progress=lines.append)
    np.testing.assert_array_equal(result.flow, quiet.flow)
    assert lines == []  # it took no two seconds
    times_s = iter([0.0, 1.0, 2.5, 2.6, 3.0, 4.6])
    report = StepReport(lines.append, clock=lambda: next(times_s))
    assert [report() for _ in range(5)] == [False] * 5
    assert lines == ["estimating: step 2, 2 s", "estimating: step 5, 5 s"]


def test_without_previous_it_is_the_two_frame_method(scene):
    result = estimate_flow(scene.current, scene.next, settings=SHORT)
    assert list(result.fits) == ["forward"]
    assert result.flow.shape == scene.current.shape


def as_float64(array):
    return array.astype(np.float64)


def as_columns(array):
    return np.asfortranarray(array)


def as_slice(array):
    wide = np.full((2 * len(array), 5), np.nan, np.float32)
    wide[::2, :3] = array
    return wide[::2]


def as_read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


@pytest.mark.parametrize(
    "form", [as_float64, as_columns, as_slice, as_read_only, np.ndarray.tolist]
)
def test_form_of_the_arrays_does_not_matter(scene, form, settings):
    sweeps = [form(xyz) for xyz in (scene.current, scene.next, scene.previous)]
    flow = estimate_flow(*sweeps, settings).flow
    np.testing.assert_array_equal(flow, estimate(scene, settings).flow)


def test_whole_numbers(scene, settings):
    current, newest = (np.round(10 * xyz).astype(np.int32) for xyz in (scene.current, scene.next))
    result = estimate_flow(current, newest, settings=settings)
    assert result.flow.shape == current.shape
    assert np.isfinite(result.flow).all()


def test_arrays_are_not_written_to(scene, settings):
    sweeps = scene.current, scene.next, scene.previous
    before = [xyz.copy() for xyz in sweeps]
    estimate_flow(*sweeps, settings)
    for xyz, copy in zip(sweeps, before, strict=True):
        np.testing.assert_array_equal(xyz, copy)


def test_calls_do_not_depend_on_each_other(scene, make_scene, settings):
    first = estimate(scene, settings).flow
    estimate(make_scene(seed=5), settings)
    np.testing.assert_array_equal(estimate(scene, settings).flow, first)


def refused(text, settings=SHORT, **sweeps):
    with pytest.raises(SweepError, match=f"^{re.escape(text)}"):
        estimate_flow(**sweeps, settings=settings)


@pytest.mark.parametrize("name", ["current", "next", "previous"])
def test_error_names_the_array(scene, name):
    sweeps = {"current": scene.current, "next": scene.next, "previous": scene.previous}
    with_nan = sweeps[name].copy()
    with_nan[3, 1] = np.nan
    refused(
        f"{name}: 1 of {len(with_nan)} points are not finite; remove them",
        **{**sweeps, name: with_nan},
    )
    refused(
        f"{name}: got shape (3,) of float64, expected (N, 3) numbers",
        **{**sweeps, name: [0.0, 1.0, 2.0]},
    )
    refused(f"{name}: got rows of different lengths", **{**sweeps, name: [[1, 2, 3], [4]]})


@pytest.mark.parametrize("name", ["current", "next", "previous"])
@pytest.mark.parametrize(
    "points", [np.zeros((0, 3)), np.ones((1, 3)), np.full((500, 3), 1e7), np.full((500, 3), 1e20)]
)
def test_too_few_points_are_left(scene, name, points, settings):
    sweeps = {"current": scene.current, "next": scene.next, "previous": scene.previous}
    refused(
        f"sweep 0: 0 of {len(points)} points are left after crop and ground removal, "
        "expected at least 10",
        settings,
        **{**sweeps, name: points},
    )


def test_no_finite_flow(scene):
    explosive = SHORT.changed(
        {
            "optimization.learning_rate": 1,
            "optimization.decay": False,
            "optimization.max_iterations": 10,
            "optimization.batch_points": 100,
            "field.num_hidden_layers": 30,
            "field.hidden_width": 64,
        }
    )
    with pytest.raises(OptimizationError, match=r"^the loss became nan, expected a finite number"):
        estimate(scene, explosive)


def test_every_refusal_has_one_root():
    with pytest.raises(MnsfError):
        estimate_flow([], [])
