# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings of the simulated recording, and its scenario: what is drawn, and how often."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple, TypeVar

import numpy as np

from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import check_declared, declared, settings_of

Item = TypeVar("Item")

BEAM_CHOICES = (16, 32, 64, 128)
# Places under a roof; the lidar is on a robot, or carried by hand.
INDOORS = ("rooms", "carried")
SCENARIOS = ("street", "random", "adverse", "standing", "turns", *INDOORS)
# Of adverse worlds, see conditions.py and docs/recordings.md; each world has some of them.
CONDITIONS = ("jitter", "gaps", "body", "walls", "wet", "fog", "kerbs", "lidar", "groups")
_CONDITION_SHARE = 0.4
_DRAWN = "drawn"
_OF_ALL_SCENARIOS = (
    *("seed", "duration_s", "scenario", "conditions", "imu_hz", "stands_s", "directions"),
)
# Of a random world: names to shares, and to the lowest and highest speed.
_PLACES = {"street": 0.35, "crossing": 0.2, "country road": 0.15, "square": 0.2, "tunnel": 0.1}
_EGOS = {"standing": 0.2, "on foot": 0.2, "driving": 0.4, "fast": 0.2}
_SPEEDS_M_S = {
    "standing": (0.0, 0.0),
    "on foot": (0.5, 1.8),
    "driving": (3.0, 15.0),
    "fast": (15.0, 25.0),
}
_BEHAVIOURS = {"steady": 0.5, "brakes": 0.2, "starts": 0.15, "changes": 0.15}
_NUMBERS = {0.0: 0.1, 4.0: 0.3, 12.0: 0.35, 30.0: 0.25}


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of a simulation. Equal settings give equal recordings, byte for byte.

    All scenarios but `street` draw lidar, rate and speed.

    Raises:
        SettingsError: If a value is of the wrong type or out of its range, or is set although the
            scenario draws it.
    """

    seed: int = declared(0, "chooses street, traffic and noise", 0, 2**63 - 1)
    duration_s: float = declared(10.0, "duration in seconds", 0.1, 120)
    rate_hz: float = declared(10.0, "sweeps per second", 1, 50)
    num_beams: int = declared(64, f"lasers: {', '.join(map(str, BEAM_CHOICES))}")
    num_columns: int = declared(1900, "azimuth steps of a sweep", 36, 8192)
    ego_speed_m_s: float = declared(8.0, "speed of the vehicle with the lidar", 0, 20)
    stands_s: float = declared(0.0, "stands for so long, then accelerates with 3 m/s²", 0, 60)
    scenario: str = declared(
        "street",
        "random: drawn lidar, place, traffic; adverse: with conditions; standing: no movers; "
        "turns: random, with hard turns; rooms: indoors, on a robot; carried: indoors, by hand",
        choices=SCENARIOS,
    )
    imu_hz: float = declared(0.0, "turn rates of a cheap IMU per second on /imu, 0: none", 0, 1000)
    directions: str = declared(
        "changing", "fixed: each sweep measures in the same ones", choices=("changing", "fixed")
    )
    conditions: str = declared(_DRAWN, f"of adverse, with commas: {', '.join(CONDITIONS)}")

    def __post_init__(self) -> None:
        check_declared(self)
        if self.num_beams not in BEAM_CHOICES:
            *most, last = BEAM_CHOICES
            expected = f"{', '.join(map(str, most))} or {last}"
            raise SettingsError(f"num_beams: got {self.num_beams}, expected {expected}")
        is_known = self.scenario == "adverse" and set(self.conditions.split(",")) <= {*CONDITIONS}
        if self.conditions != _DRAWN and not is_known:
            raise SettingsError(
                f"conditions: got {self.conditions!r} with scenario={self.scenario}, expected "
                f"scenario=adverse and names with commas between: {', '.join(CONDITIONS)}"
            )
        if self.scenario != "street":
            for setting in settings_of(SimulationSettings):
                value = getattr(self, setting.name)
                if setting.name not in _OF_ALL_SCENARIOS and value != setting.default:
                    raise SettingsError(
                        f"{setting.name}: got {value}, but the scenario {self.scenario} draws it"
                    )


class Scenario(NamedTuple):
    """Differences between scenarios; the default is a random world."""

    places: Mapping[str, float] = _PLACES
    egos: Mapping[str, float] = _EGOS  # how the lidar moves
    speeds_m_s: Mapping[str, tuple[float, float]] = _SPEEDS_M_S  # lowest and highest of each
    behaviours: Mapping[str, float] = _BEHAVIOURS  # of ego vehicle and traffic
    numbers: Mapping[float, float] = _NUMBERS  # mean number of movers
    reach_m: tuple[float, float] = (-35.0, 55.0)  # from behind to ahead, where traffic begins
    level: float = 0.7  # share of places without a slope
    conditions: frozenset[str] = frozenset()  # some of `CONDITIONS`
    turns_deg_s: tuple[float, float] | None = None  # lowest and highest peak of weaving


def scenario_of(settings: SimulationSettings) -> Scenario:
    """Returns the scenario of the settings."""
    if settings.scenario == "random":
        return Scenario()
    if settings.scenario == "standing":
        return Scenario(numbers={0: 1.0})
    if settings.scenario == "turns":
        # Robots turn on the spot with 60 to 120 degrees/s, hands with more.
        return Scenario(
            egos={"on foot": 0.5, "driving": 0.5},
            speeds_m_s={"on foot": (0.5, 1.8), "driving": (3.0, 8.0)},
            behaviours={"steady": 1.0},
            turns_deg_s=(60.0, 200.0),
        )
    if settings.scenario == "adverse":
        return Scenario(conditions=frozenset(_conditions(settings)))
    # Oncoming traffic is met until the end.
    ahead_m = 55.0 + 1.5 * settings.ego_speed_m_s * settings.duration_s
    return Scenario(
        places={"crossing": 1.0},
        egos={"driving": 1.0},
        speeds_m_s={"driving": (settings.ego_speed_m_s, settings.ego_speed_m_s)},
        behaviours={"steady": 1.0},
        numbers={0.22 * (35.0 + ahead_m): 1.0},
        reach_m=(-35.0, ahead_m),
        level=1.0,
    )


def _conditions(settings: SimulationSettings) -> Iterable[str]:
    """Returns the conditions that are set, or drawn."""
    if settings.conditions != _DRAWN:
        return settings.conditions.split(",")
    has_each = np.random.default_rng([settings.seed, 5]).uniform(size=len(CONDITIONS))
    return compress(CONDITIONS, has_each < _CONDITION_SHARE)


def drawn(shares: Mapping[Item, float], rng: np.random.Generator) -> Item:
    """Returns one of the keys, with the probability of its share."""
    names, weights = list(shares), np.array(list(shares.values()))
    return names[rng.choice(len(names), p=weights / weights.sum())]
