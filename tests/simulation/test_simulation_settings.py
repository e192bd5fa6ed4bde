from __future__ import annotations

import pytest

from mnsf_ros.errors import SettingsError
from mnsf_ros.simulation.settings import SimulationSettings


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("seed", -1, "seed: expected 0 to"),
        ("seed", 1.5, "seed: expected an integer, got 1.5"),
        ("seed", True, "seed: expected an integer, got True"),
        ("duration_s", 0.0, "duration_s: expected 0.1 to 120, got 0"),
        ("duration_s", float("nan"), "duration_s: expected a finite number, got nan"),
        ("rate_hz", 1000, "rate_hz: expected 1 to 50"),
        ("num_beams", 48, r"num_beams: expected one of \(16, 32, 64, 128\), got 48"),
        ("num_columns", 10, "num_columns: expected 36 to 8192, got 10"),
        ("range_noise_m", -0.1, "range_noise_m: expected 0 to 1"),
        ("dropout", 1.0, "dropout: must be below 1"),
        ("ego_speed_m_s", "8", "ego_speed_m_s: expected a finite number, got '8'"),
        ("scenario", "mall", r"scenario: expected one of \('street', "),
        ("max_range_m", 1.0, "max_range_m: expected 5 to 300"),
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
