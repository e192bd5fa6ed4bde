# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings and presets: one declaration, checked wherever a value comes in."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest

from mnsf_ros.errors import MnsfError, SettingsError
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings, declared_setting, declared_settings

ALL = declared_settings()
NUMBERS = [setting for setting in ALL if setting.kind in (int, float)]


def named(settings):
    return [pytest.param(setting, id=setting.name) for setting in settings]


def refused(name, value, expected):
    text = f"{name}: got {value!r}, expected {expected}"
    with pytest.raises(SettingsError, match=f"^{re.escape(text)}$"):
        declared_setting(name).checked(value)


@pytest.mark.parametrize("setting", named(ALL))
def test_declaration_is_complete(setting):
    assert setting.kind in (bool, int, float, str)
    assert setting.text.strip()
    assert "\n" not in setting.text
    # Any method may be named, those of other packages, too, any field of a cloud, any frame.
    is_free = setting.name in ("method.name", "time.field") or setting.name.endswith("frame")
    assert bool(setting.choices) == (setting.kind is str and not is_free)


@pytest.mark.parametrize("setting", named(ALL))
def test_default_is_allowed_and_of_the_declared_type(setting):
    assert setting.checked(setting.default) == setting.default
    assert type(setting.default) is setting.kind


@pytest.mark.parametrize("setting", named(NUMBERS))
def test_range_ends_are_allowed_and_nothing_beyond(setting):
    for end in (setting.minimum, setting.maximum):
        assert setting.checked(end) == end
        assert type(setting.checked(end)) is setting.kind
    step = 1 if setting.kind is int else 1e-9 * max(1, setting.maximum)
    for value in (setting.minimum - step, setting.maximum + step):
        with pytest.raises(SettingsError, match=re.escape(setting.range_text(" from {} to {}"))):
            setting.checked(value)


def test_setting_of_an_earlier_version_is_explained():
    with pytest.raises(SettingsError, match=r"field\.kind.*method\.name.*online.*mnsf"):
        Settings().changed({"field.kind": "network"})


def test_presets_name_their_method():
    assert {name: preset(name).method.name for name in PRESET_NAMES} == {
        "online": "online",
        "neural": "mnsf",
        "paper": "mnsf",
        "authors": "mnsf",
    }


def test_names_are_unique():
    assert len({setting.name for setting in ALL}) == len(ALL)


def test_whole_number_is_taken_for_a_number():
    value = declared_setting("crop.max_range_m").checked(50)
    assert value == 50.0
    assert type(value) is float


def test_number_without_fraction_is_taken_for_a_whole_number():
    value = declared_setting("early_stopping.patience").checked(3.0)
    assert value == 3
    assert type(value) is int


@pytest.mark.parametrize("value", [True, False, "50", None, [50.0], 50j])
def test_not_a_number(value):
    refused("crop.max_range_m", value, "a number from 1 to 1000")
    refused("early_stopping.patience", value, "a whole number from 0 to 100000")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_not_finite(value):
    refused("crop.max_range_m", value, "a number from 1 to 1000")
    refused("early_stopping.patience", value, "a whole number from 0 to 100000")


@pytest.mark.parametrize("value", [10**400, -(10**400)], ids=["huge", "-huge"])
def test_whole_number_too_large_for_a_float(value):
    refused("crop.max_range_m", value, "a number from 1 to 1000")
    refused("early_stopping.patience", value, "a whole number from 0 to 100000")


def test_fraction_for_a_whole_number():
    refused("early_stopping.patience", 2.5, "a whole number from 0 to 100000")


@pytest.mark.parametrize("value", [0, 1, 1.0, "true", None])
def test_not_true_or_false(value):
    refused("ground.remove", value, "true or false")


@pytest.mark.parametrize("value", ["median", "MLP", "", 1, True, None])
def test_not_one_of_the_words(value):
    refused("fusion.kind", value, "one of mlp, weighted_sum, mean")


def test_true_false_and_words_are_taken_as_they_are():
    assert declared_setting("ground.remove").checked(False) is False
    assert declared_setting("fusion.kind").checked("mean") == "mean"


def test_range_text():
    assert declared_setting("crop.max_range_m").range_text() == "1 to 1000"
    assert declared_setting("distance.kind").range_text() == "grid, tree, auto"
    assert declared_setting("ground.remove").range_text() == ""


def test_unknown_name_gets_a_suggestion():
    with pytest.raises(
        SettingsError, match=r"^unknown setting 'crop\.max_rang_m'; did you mean "
    ) as info:
        Settings().changed({"crop.max_rang_m": 1.0})
    assert "crop.max_range_m" in str(info.value)


@pytest.mark.parametrize("name", ["zzz", "crop", "", "crop."])
def test_unknown_name(name):
    with pytest.raises(SettingsError, match=f"^unknown setting {name!r}"):
        Settings().changed({name: 1})


def test_errors_can_be_caught_as_root_and_as_value_error():
    with pytest.raises(MnsfError):
        Settings().changed({"crop.max_range_m": -1})
    with pytest.raises(ValueError, match=r"crop\.max_range_m"):
        Settings().changed({"crop.max_range_m": -1})


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            {"crop.min_range_m": 80},
            "crop.min_range_m: got 80.0, expected less than crop.max_range_m, which is 80.0",
        ),
        (
            {"crop.min_range_m": 30, "crop.max_range_m": 20},
            "crop.min_range_m: got 30.0, expected less than crop.max_range_m, which is 20.0",
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
    ],
)
def test_values_that_contradict_each_other(values, text):
    with pytest.raises(SettingsError, match=f"^{re.escape(text)}$"):
        Settings().changed(values)


def test_only_the_outcome_must_agree_not_the_steps_to_it():
    far = {"crop.min_range_m": 100, "crop.max_range_m": 200}
    for values in (far, dict(reversed(far.items()))):
        crop = Settings().changed(values).crop
        assert (crop.min_range_m, crop.max_range_m) == (100, 200)


def test_change_makes_a_new_object_and_leaves_the_old_one_alone():
    old = Settings()
    new = old.changed({"crop.max_range_m": 50, "fusion.kind": "mean"})
    assert (new.crop.max_range_m, new.fusion.kind) == (50.0, "mean")
    assert old == Settings()
    assert dataclasses.replace(new, crop=old.crop, fusion=old.fusion) == old


def test_refused_change_changes_nothing():
    old = Settings()
    with pytest.raises(SettingsError):
        old.changed({"fusion.kind": "mean", "crop.max_range_m": -1})
    assert old == Settings()


def test_no_attribute_can_be_set():
    settings = Settings()
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.crop = None
    for group in {setting.name.partition(".")[0] for setting in ALL}:
        values = getattr(settings, group)
        for item in dataclasses.fields(values):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(values, item.name, None)


def test_explicit_are_the_settings_that_were_changed_from_a_preset():
    settings = preset("paper")
    assert settings.explicit == frozenset()
    changed = settings.changed({"crop.max_range_m": 80.0}).changed({"compute.seed": 1})
    assert changed.explicit == {"crop.max_range_m", "compute.seed"}
    assert settings.changed({"crop.max_range_m": 80.0}) == settings


def test_mapping_names_every_setting_in_order_with_its_value():
    settings = Settings().changed({"crop.max_range_m": 50})
    mapping = settings.to_mapping()
    assert list(mapping) == [setting.name for setting in ALL]
    assert mapping["crop.max_range_m"] == 50.0
    assert mapping["fusion.kind"] == settings.value_of("fusion.kind") == "mlp"


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_mapping_and_back(name):
    settings = preset(name)
    assert Settings().changed(settings.to_mapping()) == settings


def test_online_preset_is_the_default():
    assert preset("online") == Settings()


def test_paper_preset_is_the_paper():
    settings = preset("paper")
    assert (settings.field.num_hidden_layers, settings.field.hidden_width) == (8, 128)
    assert (settings.fusion.kind, settings.fusion.num_hidden_layers) == ("mlp", 3)
    assert (settings.distance.kind, settings.distance.cell_size_m) == ("grid", 0.1)
    assert settings.distance.truncation_m == 0
    assert (settings.early_stopping.patience, settings.early_stopping.min_delta_m) == (10, 0.001)
    assert (settings.optimization.learning_rate, settings.optimization.decay) == (0.01, False)
    # Every point in every step, no hurry, and nothing handed from one triplet to the next.
    assert settings.optimization.batch_points == settings.optimization.max_points == 0
    assert settings.optimization.time_budget_ms == 0
    assert not settings.warm_start.enabled
    assert settings.ground.remove
    assert (settings.crop.max_height_m, settings.crop.max_range_m) == (4, 80)


def test_unknown_preset():
    with pytest.raises(
        SettingsError,
        match=r"^unknown preset 'fast', expected one of online, neural, paper, "
        "authors$",
    ):
        preset("fast")
