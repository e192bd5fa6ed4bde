# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings and presets: one declaration, checked wherever a value comes in."""

import dataclasses
import math
import re

import pytest

from mnsf_ros.errors import MnsfError, SettingsError
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings, declared_setting, declared_settings

ALL = declared_settings()
NUMBER, WHOLE = "a number from 1 to 1000", "a whole number from 0 to 100000"


def test_declarations_are_complete_and_names_unique():
    assert len({setting.name for setting in ALL}) == len(ALL)
    for setting in ALL:
        assert setting.text.strip(), setting.name
        assert "\n" not in setting.text
        # Any method may be named, those of other packages, too, any field of a cloud, any frame,
        # any boxes.
        is_free = setting.name in ("method.name", "time.field", "crop.own_body")
        is_free |= setting.name.endswith("frame")
        assert bool(setting.choices) == (setting.kind is str and not is_free), setting.name
        assert setting.checked(setting.default) == setting.default
        assert type(setting.default) is setting.kind in (bool, int, float, str)


def test_range_ends_are_allowed_and_nothing_beyond():
    for setting in ALL:
        if setting.kind not in (int, float):
            continue
        for end in (setting.minimum, setting.maximum):
            assert setting.checked(end) == end
            assert type(setting.checked(end)) is setting.kind
        step = 1 if setting.kind is int else 1e-9 * max(1, setting.maximum)
        for value in (setting.minimum - step, setting.maximum + step):
            text = f"^{setting.name}: got .* {re.escape(setting.range_text('from {} to {}'))}$"
            with pytest.raises(SettingsError, match=text):
                setting.checked(value)


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("crop.max_range_m", 50, 50.0),
        ("early_stopping.patience", 3.0, 3),
        ("ground.remove", False, False),
        ("fusion.kind", "mean", "mean"),
    ],
)
def test_values_of_another_type_are_converted_where_nothing_is_lost(name, given, value):
    checked = declared_setting(name).checked(given)
    assert checked == value
    assert type(checked) is type(value)


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("crop.max_range_m", (True, "50", None, [50.0], 50j), NUMBER),
        ("crop.max_range_m", (math.nan, math.inf, -math.inf, 10**400, -(10**400)), NUMBER),
        ("early_stopping.patience", (True, "50", None, 2.5), WHOLE),
        ("early_stopping.patience", (math.nan, math.inf, 10**400), WHOLE),
        ("ground.remove", (0, 1, 1.0, "true", None), "true or false"),
        ("fusion.kind", ("median", "MLP", "", 1, True), "one of mlp, weighted_sum, mean"),
    ],
)
def test_values_that_are_refused(name, values, expected):
    for value in values:
        text = f"{name}: got {value!r}, expected {expected}"
        with pytest.raises(SettingsError, match=f"^{re.escape(text)}$") as refusal:
            Settings().changed({name: value})
        assert isinstance(refusal.value, MnsfError)
        assert isinstance(refusal.value, ValueError)


def test_refusals_do_not_repeat_a_large_value():
    large = "x" * 1_000_000
    for changes in ({"fusion.kind": large}, {"crop.max_range_m": [large] * 9}, {large: 1}):
        with pytest.raises(SettingsError) as refusal:
            Settings().changed(changes)
        assert len(str(refusal.value)) < 5000


def test_unknown_names():
    with pytest.raises(
        SettingsError, match=r"^unknown setting 'crop\.max_rang_m'; did you mean .*"
    ):
        Settings().changed({"crop.max_rang_m": 1.0})
    for name in ("zzz", "crop", "", "crop."):
        with pytest.raises(SettingsError, match=f"^unknown setting {name!r}"):
            Settings().changed({name: 1})
    text = "^unknown preset 'fast', expected one of online, mnsf, paper, authors$"
    with pytest.raises(SettingsError, match=text):
        preset("fast")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            {"crop.min_range_m": 30, "crop.max_range_m": 20},
            "crop.min_range_m: got 30.0, expected less than crop.max_range_m, which is 20.0",
        ),
        *(
            (
                {"crop.own_body": f"0 0 0 1 1 1;{text}"},
                f"crop.own_body: got {text!r}, expected auto, none, or boxes with semicolons "
                "between, each as x y z of two opposite corners in metres",
            )
            for text in ("", "0 0 0 1 1", "0 0 0 1 1 one", "0 0 0 1 1 nan")
        ),
        (
            {"time.field": "clockwise:north"},
            "time.field: got 'clockwise:north', expected an azimuth in degrees: clockwise:180",
        ),
        (
            {"crop.max_height_m": -25},
            "crop.min_height_m: got -20.0, expected less than crop.max_height_m, which is -25.0",
        ),
        (
            {"buffer.min_interval_s": 0.6},
            "buffer.min_interval_s: got 0.6, expected less than buffer.max_interval_s, "
            "which is 0.5",
        ),
        *(
            (
                {"distance.kind": kind, "distance.truncation_m": 0},
                f"distance.kind: got '{kind}' with distance.truncation_m 0, expected a truncation: "
                "set one above 0, or use grid or tree",
            )
            for kind in ("bricks", "cells")
        ),
    ],
)
def test_values_that_contradict_each_other(values, text):
    with pytest.raises(SettingsError, match=f"^{re.escape(text)}$"):
        Settings().changed(values)


@pytest.mark.parametrize(
    ("values", "unused"),
    [
        ({"lidar_1.roll_deg": 180.0}, ""),
        ({"lidar_2.x_m": 1.0}, "lidar_2.x_m without effect"),
        ({"lidars.count": 2, "lidar_1.x_m": 1.0}, "lidar_1.x_m without effect"),
        ({"lidars.count": 2, "lidars.poses": "parameters", "lidar_2.x_m": 1.0}, ""),
    ],
)
def test_poses_of_lidars_without_effect_are_known(values, unused):
    assert Settings().changed(values).without_effect.startswith(unused)
    assert bool(Settings().changed(values).without_effect) == bool(unused)


def test_change_makes_a_new_object_and_leaves_the_old_one_alone():
    old = Settings()
    new = old.changed({"crop.max_range_m": 50, "fusion.kind": "mean"})
    assert (new.crop.max_range_m, new.fusion.kind) == (50.0, "mean")
    with pytest.raises(SettingsError):
        old.changed({"fusion.kind": "mean", "crop.max_range_m": -1})
    assert old == Settings() == dataclasses.replace(new, crop=old.crop, fusion=old.fusion)
    for owner, name in ((old, "crop"), (old.crop, "max_range_m")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(owner, name, None)


def test_explicit_are_the_settings_that_were_changed_from_a_preset():
    settings = preset("paper")
    assert settings.explicit == frozenset()
    changed = settings.changed({"crop.max_range_m": 80.0}).changed({"compute.seed": 1})
    assert changed.explicit == {"crop.max_range_m", "compute.seed"}
    assert settings.changed({"crop.max_range_m": 80.0}) == settings


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_mapping_and_back(name):
    settings = preset(name).changed({"crop.max_range_m": 50})
    mapping = settings.to_mapping()
    assert list(mapping) == [setting.name for setting in ALL]
    assert mapping["crop.max_range_m"] == settings.value_of("crop.max_range_m") == 50.0
    assert Settings().changed(mapping) == settings


def test_paper_preset_is_the_paper():
    settings = preset("paper")
    assert (settings.field.num_hidden_layers, settings.field.hidden_width) == (8, 128)
    assert (settings.fusion.kind, settings.fusion.num_hidden_layers) == ("mlp", 3)
    assert (settings.distance.kind, settings.distance.cell_size_m) == ("grid", 0.1)
    assert settings.distance.truncation_m == 0
    assert (settings.early_stopping.patience, settings.early_stopping.min_delta_m) == (10, 0.001)
    assert (settings.optimization.learning_rate, settings.optimization.decay) == (0.01, False)
    # Every point in every step, no time limit, and nothing carried from one triplet to the next.
    assert settings.optimization.max_points == 0
    assert settings.optimization.time_budget_ms == 0
    assert not settings.warm_start.enabled
    assert settings.ground.remove
    assert (settings.crop.max_height_m, settings.crop.max_range_m) == (4, 80)
