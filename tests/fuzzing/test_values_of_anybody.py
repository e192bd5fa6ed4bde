# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings of any value: one that fits, or an error of one line."""

import math

from hypothesis import given
from hypothesis import strategies as st

from mnsf_ros.errors import SettingsError
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
