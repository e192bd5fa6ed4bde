# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Everything at rest along the street: houses, trees, lamps, furniture and parked cars."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation import models
from mnsf_ros.simulation.bodies import Body, Model
from mnsf_ros.simulation.street import (
    FACADE_LATERAL_M,
    FURNITURE_LATERAL_M,
    PARKING_LATERAL_M,
    SIDE_FACADE_M,
    SIDE_STREET_LENGTH_M,
    Street,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


_HOUSE_WIDTH_M = 11.0
# On the outside of a bend straight walls would leave gaps.
_HOUSE_OVERLAP_M = 0.8
_PARKING_PITCH_M = 6.4
_SIDES = (1.0, -1.0)


def roadside_bodies(street: Street, rng: np.random.Generator) -> list[Body]:
    """Returns all things at rest; equal generators give equal streets."""
    return [
        *_main_houses(street, rng),
        *_side_houses(street, rng),
        *_furniture(street, rng),
        *_corner_posts(street, rng),
        *_parked_cars(street, rng),
    ]


def _away_from_street(side: float) -> float:
    """Returns the turn that points a model's +y away from the street on the given side."""
    return 0.0 if side > 0 else math.pi


def _row(start: float, end: float, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Yields center and width of houses that fill the interval from start to end."""
    count = max(1, round((end - start) / _HOUSE_WIDTH_M))
    weights = rng.uniform(0.7, 1.3, count)
    edges = start + (end - start) * np.concatenate([[0.0], np.cumsum(weights) / weights.sum()])
    for left, right in itertools.pairwise(edges):
        yield float(left + right) / 2, float(right - left)


def _main_houses(street: Street, rng: np.random.Generator) -> Iterator[Body]:
    ends = [street.start_x]
    for crossing in street.crossings:
        ends += [crossing.x - SIDE_FACADE_M, crossing.x + SIDE_FACADE_M]
    ends.append(street.end_x)
    for side in _SIDES:
        for start, end in zip(ends[::2], ends[1::2], strict=True):
            for x, width in _row(start, end, rng):
                wall = FACADE_LATERAL_M + rng.uniform(0.0, 0.5)
                lateral = side * (wall - models.HOUSE_WALL_Y_M)
                pose = street.pose(x, lateral, _away_from_street(side))
                yield Body(models.house(rng, width + _HOUSE_OVERLAP_M), pose)


def _side_houses(street: Street, rng: np.random.Generator) -> Iterator[Body]:
    # Behind the corner houses of the main street, which close the first metres of the side.
    begin = FACADE_LATERAL_M + models.HOUSE_DEPTH_M + 1.0
    for crossing in street.crossings:
        for side in _SIDES:
            for flank in _SIDES:
                for lateral, width in _row(begin, SIDE_STREET_LENGTH_M, rng):
                    wall = SIDE_FACADE_M + rng.uniform(0.0, 0.4)
                    x = crossing.x + flank * (wall - models.HOUSE_WALL_Y_M)
                    pose = street.pose(x, side * lateral, -flank * math.pi / 2)
                    yield Body(models.house(rng, width + _HOUSE_OVERLAP_M), pose)


def _furniture(street: Street, rng: np.random.Generator) -> Iterator[Body]:
    # Weighted draw by repetition: trees and lamps make the street.
    catalogue: list[Callable[[np.random.Generator], Model]] = [
        *[models.tree] * 5,
        *[models.lamp_post] * 2,
        *[models.sign] * 2,
        models.litter_bin,
        models.cabinet,
        models.bench,
        models.shelter,
    ]
    for side in _SIDES:
        x = street.start_x + rng.uniform(2.0, 6.0)
        while x < street.end_x:
            draw = catalogue[int(rng.integers(len(catalogue)))]
            if street.clear_of_crossings(x, 12.0):
                turn = _away_from_street(side)
                if draw is models.lamp_post:
                    turn -= math.pi / 2
                elif draw is models.sign:
                    turn += rng.normal(0.0, 0.1)
                yield Body(draw(rng), street.pose(x, side * FURNITURE_LATERAL_M, turn))
            x += rng.uniform(4.5, 8.5)


def _corner_posts(street: Street, rng: np.random.Generator) -> Iterator[Body]:
    for crossing in street.crossings:
        for side in _SIDES:
            for flank in _SIDES:
                pose = street.pose(crossing.x + flank * 5.2, side * FURNITURE_LATERAL_M)
                yield Body(models.sign(rng), pose)


def _parked_cars(street: Street, rng: np.random.Generator) -> Iterator[Body]:
    for side in _SIDES:
        for x in np.arange(street.start_x, street.end_x, _PARKING_PITCH_M):
            taken, is_van = rng.uniform() < 0.68, rng.uniform() < 0.15
            model = models.van(rng) if is_van else models.car(rng)
            if not taken or not street.clear_of_crossings(float(x), 14.5):
                continue
            lateral = side * (PARKING_LATERAL_M + rng.uniform(-0.08, 0.08))
            turn = _away_from_street(side) + rng.normal(0.0, 0.015)
            yield Body(model, street.pose(float(x), lateral, turn))
