# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scenarios: what lidar, place, ego motion and traffic are drawn from, and how often.

Tables give the share of each name. Laterals are metres to the left of the middle of the street.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Model

if TYPE_CHECKING:
    from mnsf_ros.simulation.settings import SimulationSettings

Maker = Callable[[np.random.Generator], Model]
Item = TypeVar("Item")

LIDARS: Final = {"16": 0.2, "32": 0.2, "64": 0.2, "128": 0.2, "raster": 0.1, "rosette": 0.1}
COLUMNS: Final = {900: 0.3, 1024: 0.3, 1800: 0.4}
BACKS: Final[dict[str, dict[str, float]]] = {
    "street": {"houses": 0.4, "shops": 0.25, "hedge": 0.2, "fence": 0.15},
    "crossing": {"houses": 0.6, "shops": 0.2, "hedge": 0.1, "fence": 0.1},
    "country road": {"hedge": 0.2, "fence": 0.3, "bank": 0.4, "nothing": 0.1},
    "square": {"houses": 0.6, "nothing": 0.4},
    "tunnel": {"nothing": 1.0},
}
# Of a back: its things, their spacing, and how far behind the edge their origins are.
BACK_ROWS: Final[dict[str, tuple[Maker, float, float]]] = {
    "houses": (partial(models.house, width_m=11.0), 10.9, 4.0 - models.HOUSE_WALL_Y_M),
    "shops": (models.shop, 9.0, 8.5),
    "hedge": (models.hedge, 4.1, 3.3),
    "fence": (models.fence, 4.0, 3.2),
    "bank": (models.bank, 10.0, 3.2),
}
POSTS: Final[tuple[Maker, ...]] = (
    *(models.tree, models.tree, models.lamp_post, models.sign, models.bollard, models.bollard),
    *(models.litter_bin, models.cabinet, models.bench),
)
PARKED: Final[tuple[Maker, ...]] = (models.car, models.car, models.car, models.van, models.lorry)
ON_SQUARE: Final[tuple[Maker, ...]] = (*POSTS, *PARKED, models.hedge, models.shelter)
# Sway over that of a car on its springs.
SHAKEN: Final = {"standing": 0.1, "on foot": 6.0, "driving": 1.0, "fast": 2.0}


@dataclass(frozen=True)
class Kind:
    """Traffic of one kind: its share, models, speeds, and where it goes.

    Of two models the second one follows `behind_m` behind the first one, `beside_m` left of it.
    """

    share: float
    makers: tuple[Maker, ...]
    speeds_m_s: tuple[float, float]
    way: str
    behind_m: float = 0.0
    beside_m: float = 0.0


KINDS: Final = (
    Kind(0.2, (models.car,), (2.0, 20.0), "lane"),
    Kind(0.06, (models.van,), (2.0, 18.0), "lane"),
    Kind(0.07, (models.lorry,), (1.0, 16.0), "lane"),
    Kind(0.03, (models.coach,), (2.0, 12.0), "lane"),
    Kind(0.03, (models.bus_part, models.bus_part), (2.0, 10.0), "lane", behind_m=9.0),
    Kind(0.03, (models.car, models.trailer), (2.0, 12.0), "lane", behind_m=4.2),
    Kind(0.08, (models.cyclist,), (2.0, 8.0), "edge"),
    Kind(0.06, (models.scooter,), (4.0, 14.0), "edge"),
    Kind(0.14, (models.pedestrian,), (0.5, 2.0), "sidewalk"),
    Kind(0.05, (models.pedestrian, models.child), (0.4, 1.6), "sidewalk", beside_m=0.5),
    Kind(0.03, (models.pedestrian, models.dog), (0.5, 3.0), "sidewalk", behind_m=0.9),
    Kind(0.08, (models.pedestrian,), (0.5, 2.5), "across"),
    Kind(0.03, (models.child,), (1.0, 3.5), "across"),
    Kind(0.02, (models.cyclist,), (2.0, 5.0), "sidewalk"),
    Kind(0.05, (models.car,), (3.0, 18.0), "side street"),
    Kind(0.04, (models.van,), (3.0, 5.0), "turn"),
)


@dataclass(frozen=True)
class Scenario:
    """What scenarios differ in; the default is a random world.

    Attributes:
        places: Of which kind the place is.
        egos: How the lidar moves.
        speeds_m_s: Lowest and highest speed of each of these.
        behaviours: Of ego vehicle and traffic.
        numbers: Mean number of movers.
        reach_m: From how far behind to how far ahead of the lidar traffic begins.
        level: Share of places without a slope.
    """

    places: Mapping[str, float] = field(
        default_factory=lambda: {
            "street": 0.35,
            "crossing": 0.2,
            "country road": 0.15,
            "square": 0.2,
            "tunnel": 0.1,
        }
    )
    egos: Mapping[str, float] = field(
        default_factory=lambda: {"standing": 0.2, "on foot": 0.2, "driving": 0.4, "fast": 0.2}
    )
    speeds_m_s: Mapping[str, tuple[float, float]] = field(
        default_factory=lambda: {
            "standing": (0.0, 0.0),
            "on foot": (0.5, 1.8),
            "driving": (3.0, 15.0),
            "fast": (15.0, 25.0),
        }
    )
    behaviours: Mapping[str, float] = field(
        default_factory=lambda: {"steady": 0.5, "brakes": 0.2, "starts": 0.15, "changes": 0.15}
    )
    numbers: Mapping[float, float] = field(
        default_factory=lambda: {0: 0.1, 4: 0.3, 12: 0.35, 30: 0.25}
    )
    reach_m: tuple[float, float] = (-35.0, 55.0)
    level: float = 0.7


def scenario_of(settings: SimulationSettings) -> Scenario:
    """Returns the scenario of the settings."""
    if settings.scenario == "random":
        return Scenario()
    if settings.scenario == "standing":
        return Scenario(numbers={0: 1.0})
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


def drawn(shares: Mapping[Item, float], rng: np.random.Generator) -> Item:
    """Returns one of the keys, with the probability of its share."""
    names, weights = list(shares), np.array(list(shares.values()))
    return names[rng.choice(len(names), p=weights / weights.sum())]


def one_of(makers: Sequence[Maker], rng: np.random.Generator) -> Model:
    """Returns a specimen of one of the models."""
    return makers[int(rng.integers(len(makers)))](rng)
