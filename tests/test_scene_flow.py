# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The array API: what comes in, what comes out, what is refused."""

import re

import numpy as np
import pytest

from mnsf_ros.errors import SettingsError, SweepError
from mnsf_ros.presets import preset
from mnsf_ros.scene_flow import estimate_flow
from mnsf_ros.settings import Settings

SHORT = Settings().changed(
    {
        "compute.device": "cpu",
        "method.name": "mnsf",
        "field.num_hidden_layers": 2,
        "field.hidden_width": 16,
        "optimization.max_iterations": 5,
        "optimization.time_budget_ms": 0,
        "fusion.max_iterations": 5,
    }
)
KINDS = {"network": SHORT, "objects": Settings().changed({"compute.device": "cpu"})}


@pytest.fixture
def scene(make_scene):
    return make_scene()


@pytest.fixture(params=KINDS)
def settings(request):
    """Settings of either kind of method."""
    return KINDS[request.param]


def estimate(scene, settings=SHORT):
    return estimate_flow(scene.current, scene.next, scene.previous, settings)


def test_presets_have_names_and_the_fast_one_is_the_default(scene):
    default = estimate_flow(scene.current, scene.next, scene.previous)
    assert default.over_ground is not None
    for settings in ("online", preset("online")):
        again = estimate_flow(scene.current, scene.next, scene.previous, settings)
        np.testing.assert_array_equal(default.flow, again.flow)
    with pytest.raises(SettingsError, match="unknown preset 'slow', expected one of online"):
        estimate_flow(scene.current, scene.next, settings="slow")


def as_slice(array):
    wide = np.full((2 * len(array), 5), np.nan, np.float32)
    wide[::2, :3] = array
    return wide[::2]


def test_form_of_the_arrays_does_not_matter_and_they_are_not_written_to(scene, settings):
    sweeps = scene.current, scene.next, scene.previous
    before = [xyz.copy() for xyz in sweeps]
    expected = estimate(scene, settings).flow
    for xyz, copy in zip(sweeps, before, strict=True):
        np.testing.assert_array_equal(xyz, copy)
        xyz.setflags(write=False)
    for form in (np.float64, np.asfortranarray, as_slice, np.ndarray.tolist, np.asarray):
        flow = estimate_flow(*map(form, sweeps), settings).flow
        np.testing.assert_array_equal(flow, expected)


def refused(text, settings=SHORT, **sweeps):
    with pytest.raises(SweepError, match=f"^{re.escape(text)}"):
        estimate_flow(**sweeps, settings=settings)


@pytest.mark.parametrize("name", ["current", "next", "previous"])
def test_error_names_the_array_or_says_how_many_points_are_left(scene, name, settings):
    sweeps = {"current": scene.current, "next": scene.next, "previous": scene.previous}
    with_nan = sweeps[name].copy()
    with_nan[3, 1] = np.nan
    text = f"{name}: 1 of {len(with_nan)} points are not finite; remove them"
    refused(text, **{**sweeps, name: with_nan})
    text = f"{name}: got shape (3,) of float64, expected (N, 3) numbers"
    refused(text, **{**sweeps, name: [0.0, 1.0, 2.0]})
    for points in (np.zeros((0, 3)), np.ones((1, 3)), np.full((500, 3), 1e20)):
        text = f"sweep at 0.000 s: 0 of {len(points)} points are left after crop and ground"
        refused(text, settings, **{**sweeps, name: points})
