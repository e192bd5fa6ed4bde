# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings of the simulated recording."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import Setting, check_declared, declared, settings_of

BEAM_CHOICES = (16, 32, 64, 128)
SCENARIOS = ("street", "random", "standing")
_OF_ALL_SCENARIOS = ("seed", "duration_s", "scenario")


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of a simulation. Equal settings give equal recordings, byte for byte.

    The scenarios `random` and `standing` draw all but `seed` and `duration_s`.

    Raises:
        SettingsError: If a value is of the wrong type or out of its range, or is set although the
            scenario draws it.
    """

    seed: int = declared(0, "chooses street, traffic and noise", 0, 2**63 - 1)
    duration_s: float = declared(10.0, "duration in seconds", 0.1, 120)
    rate_hz: float = declared(10.0, "sweeps per second", 1, 50)
    num_beams: int = declared(64, f"lasers: {', '.join(map(str, BEAM_CHOICES))}")
    num_columns: int = declared(1900, "azimuth steps of a sweep", 36, 8192)
    range_noise_m: float = declared(0.02, "standard deviation of the range", 0, 1)
    dropout: float = declared(0.02, "share of returns that are dropped", 0, 1)
    ego_speed_m_s: float = declared(8.0, "speed of the vehicle with the lidar", 0, 20)
    max_range_m: float = declared(120.0, "maximum range of the lidar", 5, 300)
    scenario: str = declared(
        "street",
        "street; random: a drawn lidar, place and traffic; standing: random, nothing moves",
        choices=SCENARIOS,
    )

    def __post_init__(self) -> None:
        check_declared(self)
        if self.num_beams not in BEAM_CHOICES:
            raise SettingsError(f"num_beams: got {self.num_beams}, expected one of {BEAM_CHOICES}")
        if self.dropout == 1.0:
            raise SettingsError("dropout: must be below 1, or no point is left")
        if self.scenario != "street":
            for setting in simulation_settings():
                value = getattr(self, setting.name)
                if setting.name not in _OF_ALL_SCENARIOS and value != setting.default:
                    raise SettingsError(
                        f"{setting.name}: got {value}, but the scenario {self.scenario} draws it"
                    )


@cache
def simulation_settings() -> tuple[Setting, ...]:
    """The declarations of all settings of a simulation, in order."""
    return tuple(settings_of(SimulationSettings))
