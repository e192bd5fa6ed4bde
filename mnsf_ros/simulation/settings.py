"""Settings of the simulated recording."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mnsf_ros.errors import SettingsError
from mnsf_ros.simulation.scenarios import STAGES

BEAM_CHOICES = (16, 32, 64, 128)
SCENARIOS = ("street", "street_that_hurts", *STAGES)
_RANGES = {
    "seed": (0, 2**63 - 1),
    "duration_s": (0.1, 120),
    "rate_hz": (1, 50),
    "num_columns": (36, 8192),
    "range_noise_m": (0, 1),
    "dropout": (0, 1),
    "ego_speed_m_s": (0, 20),
    "max_range_m": (5, 300),
}


@dataclass(frozen=True)
class SimulationSettings:
    """What to simulate. Equal settings give equal recordings, byte for byte.

    Attributes:
        seed: Chooses the street, the traffic and the measurement noise; 0 or more.
        duration_s: Length of the recording in seconds, 0.1 to 120.
        rate_hz: Sweeps per second, 1 to 50.
        num_beams: Lasers of the lidar: 16, 32, 64 or 128, over the same vertical angles.
        num_columns: Azimuth steps of one revolution, 36 to 8192.
        range_noise_m: Standard deviation of the measured range in metres, 0 to 1.
        dropout: Share of returns that are lost, at least 0 and below 1.
        ego_speed_m_s: Cruising speed of the vehicle that carries the lidar, 0 to 20 m/s.
        max_range_m: Returns from farther away are lost, 5 to 300 m.
        scenario: One of `SCENARIOS`: the usual street; one with movers that are hard to find
            (people along walls and between parked cars, slow walkers, scooters beside parked
            rows, with odd seeds a lorry alongside); or one of the staged ones.

    Raises:
        SettingsError: If a value is of the wrong type or out of its range.
    """

    seed: int = 0
    duration_s: float = 10.0
    rate_hz: float = 10.0
    num_beams: int = 64
    num_columns: int = 1900
    range_noise_m: float = 0.02
    dropout: float = 0.02
    ego_speed_m_s: float = 8.0
    max_range_m: float = 120.0
    scenario: str = "street"

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            kind = int if name in ("seed", "num_columns") else float
            _check(name, getattr(self, name), kind, low, high)
        if self.num_beams not in BEAM_CHOICES or isinstance(self.num_beams, bool):
            raise SettingsError(
                f"num_beams: expected one of {BEAM_CHOICES}, got {self.num_beams!r}"
            )
        if self.dropout == 1.0:
            raise SettingsError("dropout: must be below 1, or no point is left")
        if self.scenario not in SCENARIOS:
            raise SettingsError(f"scenario: expected one of {SCENARIOS}, got {self.scenario!r}")

    @property
    def num_sweeps(self) -> int:
        """Number of sweeps in the recording, at least one."""
        return max(1, round(self.duration_s * self.rate_hz))

    @property
    def interval_s(self) -> float:
        """Seconds from one sweep to the next."""
        return 1.0 / self.rate_hz


def _check(name: str, value: object, kind: type, low: float, high: float) -> None:
    allowed = int if kind is int else int | float
    if isinstance(value, bool) or not isinstance(value, allowed) or not math.isfinite(value):
        expected = "an integer" if kind is int else "a finite number"
        raise SettingsError(f"{name}: expected {expected}, got {value!r}")
    if not low <= value <= high:
        raise SettingsError(f"{name}: expected {low} to {high}, got {value}")
