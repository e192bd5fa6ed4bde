# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings and metadata.yaml of any content: a value that fits, or an error of one line."""

from __future__ import annotations

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from mnsf_ros.errors import SettingsError
from mnsf_ros.recording.bag_files import read_metadata
from mnsf_ros.recording.damage import UNREADABLE
from mnsf_ros.settings import Settings, declared_settings

ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=12,
)
NUMBERS = st.floats() | st.integers() | st.sampled_from([10**400, -(10**400), 2**63, 1e308])


@given(st.sampled_from(declared_settings()), ANYTHING | NUMBERS)
def test_a_setting_takes_what_fits_and_refuses_the_rest_in_one_line(setting, value):
    try:
        settings = Settings().changed({setting.name: value})
    except SettingsError as error:
        assert setting.name.partition(".")[0] in str(error)
        return
    kept = settings.value_of(setting.name)
    assert type(kept) is setting.kind
    if setting.kind in (int, float):
        assert math.isfinite(kept)
        assert setting.minimum is None or setting.minimum <= kept <= setting.maximum
    assert kept == value


KEYS = (
    *("version", "storage_identifier", "relative_file_paths", "starting_time", "duration"),
    *("message_count", "topics_with_message_count", "compression_mode", "files"),
)
WHOLE = {
    "version": 9,
    "storage_identifier": "mcap",
    "relative_file_paths": ["a.mcap"],
    "starting_time": {"nanoseconds_since_epoch": 1},
    "duration": {"nanoseconds": 1},
    "message_count": 1,
    "topics_with_message_count": [],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("metadata")


@given(st.dictionaries(st.sampled_from(KEYS), ANYTHING, max_size=3))
def test_metadata_with_values_of_any_type(folder, changes):
    """It is read, or raises an error that the reader of recordings expects."""
    yaml = YAML(typ="safe")
    with (folder / "metadata.yaml").open("wb") as file:
        yaml.dump({"rosbag2_bagfile_information": WHOLE | changes}, file)
    with suppress(*UNREADABLE):
        read_metadata(folder)
