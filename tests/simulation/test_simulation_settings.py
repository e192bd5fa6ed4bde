# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from mnsf_ros.errors import SettingsError
from mnsf_ros.simulation.settings import SimulationSettings


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("seed", -1, "seed: got -1, expected a whole number from 0 to 9223372036854775807"),
        ("seed", 1.5, "seed: got 1.5, expected a whole number"),
        ("seed", True, "seed: got True, expected a whole number"),
        ("duration_s", 0.0, "duration_s: got 0.0, expected a number from 0.1 to 120"),
        ("duration_s", float("nan"), "duration_s: got nan, expected a number"),
        ("rate_hz", 1000, "rate_hz: got 1000, expected a number from 1 to 50"),
        ("num_beams", 48, r"num_beams: got 48, expected one of \(16, 32, 64, 128\)"),
        ("num_columns", 10, "num_columns: got 10, expected a whole number from 36 to 8192"),
        ("range_noise_m", -0.1, "range_noise_m: got -0.1, expected a number from 0 to 1"),
        ("dropout", 1.0, "dropout: must be below 1"),
        ("ego_speed_m_s", "8", "ego_speed_m_s: got '8', expected a number"),
        ("scenario", "mall", "scenario: got 'mall', expected one of street, "),
        ("max_range_m", 1.0, "max_range_m: got 1.0, expected a number from 5 to 300"),
    ],
)
def test_bad_value_is_named(name, value, text):
    with pytest.raises(SettingsError, match=text):
        SimulationSettings(**{name: value})


@pytest.mark.parametrize(
    ("duration_s", "rate_hz", "num_sweeps"), [(10.0, 10.0, 100), (0.1, 10, 1), (1, 20, 20)]
)
def test_number_of_sweeps(duration_s, rate_hz, num_sweeps):
    settings = SimulationSettings(duration_s=duration_s, rate_hz=rate_hz)
    assert settings.num_sweeps == num_sweeps
    assert settings.interval_s == pytest.approx(1 / rate_hz)
