# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The catalogue of things on a street. Each function draws one specimen from a generator."""

from dataclasses import replace

import numpy as np

from mnsf_ros.geometry.transforms import tilt
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.bodies import Model, Shape, box, cylinder, sphere

HOUSE_DEPTH_M = 10.0
_PORCH_M = 0.6
# The front wall in the house's own frame: the origin is the middle of wall and porch together.
HOUSE_WALL_Y_M = (_PORCH_M - HOUSE_DEPTH_M) / 2


def car(rng: np.random.Generator) -> Model:
    """Returns a passenger car: a body and a cabin."""
    length, width = rng.uniform(4.1, 4.7), rng.uniform(1.72, 1.86)
    waist, roof = rng.uniform(0.82, 0.95), rng.uniform(1.42, 1.6)
    half, side = length / 2, width / 2
    shapes = (
        box((-half, half), (-side, side), (0.22, waist)),
        box((-half + 0.25, half - 1.45), (-side + 0.12, side - 0.12), (waist, roof)),
    )
    return Model(SurfaceClass.CAR, shapes, length, width, rng.uniform(25.0, 110.0))


def van(rng: np.random.Generator) -> Model:
    """Returns a delivery van: a tall cargo box behind a short cabin."""
    length, width, roof = rng.uniform(5.2, 5.8), rng.uniform(1.9, 2.0), rng.uniform(2.0, 2.4)
    half, side = length / 2, width / 2
    shapes = (
        box((-half, half), (-side, side), (0.28, 1.05)),
        box((-half, half - 1.3), (-side, side), (1.05, roof)),
    )
    return Model(SurfaceClass.CAR, shapes, length, width, rng.uniform(60.0, 150.0))


def pedestrian(rng: np.random.Generator) -> Model:
    """Returns a person: legs, trunk and head, in one rigid pose."""
    return _person(rng, rng.uniform(1.58, 1.86), 1.0)


def child(rng: np.random.Generator) -> Model:
    """Returns a child."""
    height = rng.uniform(1.0, 1.45)
    return _person(rng, height, height / 1.7)


def _person(rng: np.random.Generator, height: float, share: float) -> Model:
    """Returns a person of a height in metres; `share` scales the thickness."""
    hips, shoulders = 0.48 * height, 0.84 * height
    shapes = (
        cylinder(0.10 * share, 0.09 * share, 0.085 * share, (0.0, hips)),
        cylinder(-0.10 * share, -0.09 * share, 0.085 * share, (0.0, hips)),
        cylinder(0.0, 0.0, 0.21 * share, (hips, shoulders)),
        sphere(0.0, 0.0, height - 0.12, 0.12),
    )
    return Model(SurfaceClass.PEDESTRIAN, shapes, 0.5, 0.5, rng.uniform(30.0, 70.0))


def dog(rng: np.random.Generator) -> Model:
    """Returns a large dog."""
    half, height = rng.uniform(0.35, 0.5), rng.uniform(0.55, 0.75)
    shapes = (
        box((-half, half), (-0.13, 0.13), (height - 0.3, height)),
        box((0.05 - half, 0.15 - half), (-0.1, 0.1), (0.0, height - 0.3)),
        box((half - 0.15, half - 0.05), (-0.1, 0.1), (0.0, height - 0.3)),
        sphere(half + 0.1, 0.0, height + 0.08, 0.12),
    )
    return Model(SurfaceClass.ANIMAL, shapes, 2 * half + 0.4, 0.3, rng.uniform(20.0, 90.0))


def cyclist(rng: np.random.Generator) -> Model:
    """Returns a person on a bicycle."""
    height = rng.uniform(1.66, 1.78)
    shapes = (
        box((-0.85, 0.85), (-0.04, 0.04), (0.04, 0.62)),
        box((-0.30, 0.30), (-0.17, 0.17), (0.55, 0.95)),
        cylinder(-0.05, 0.0, 0.2, (0.95, height - 0.22)),
        sphere(0.08, 0.0, height - 0.11, 0.12),
    )
    return Model(SurfaceClass.CYCLIST, shapes, 1.8, 0.6, rng.uniform(35.0, 80.0))


def scooter(rng: np.random.Generator) -> Model:
    """Returns a person on a motor scooter."""
    height = rng.uniform(1.62, 1.76)
    shapes = (
        box((-0.85, 0.1), (-0.16, 0.16), (0.12, 0.75)),
        box((0.35, 0.6), (-0.2, 0.2), (0.25, 1.05)),
        box((0.6, 0.85), (-0.06, 0.06), (0.03, 0.5)),
        cylinder(-0.25, 0.0, 0.22, (0.75, height - 0.26)),
        sphere(-0.2, 0.0, height - 0.13, 0.14),
    )
    return Model(SurfaceClass.CYCLIST, shapes, 1.8, 0.7, rng.uniform(35.0, 80.0))


def lorry(rng: np.random.Generator) -> Model:
    """Returns a lorry: a cabin and a long smooth box."""
    length, roof = rng.uniform(8.5, 10.5), rng.uniform(3.2, 3.6)
    half = length / 2
    shapes = (
        box((half - 2.0, half), (-1.15, 1.15), (0.4, 2.7)),
        box((-half, half - 2.3), (-1.25, 1.25), (0.9, roof)),
        box((-half + 0.8, -half + 2.4), (-1.15, 1.15), (0.05, 0.9)),
    )
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, length, 2.5, rng.uniform(60.0, 120.0))


def coach(rng: np.random.Generator) -> Model:
    """Returns a coach: one smooth box."""
    return _bus(rng, rng.uniform(5.0, 8.5))


def bus_part(rng: np.random.Generator) -> Model:
    """Returns half of an articulated bus; the other one follows 9 m behind."""
    return _bus(rng, 4.4)


def _bus(rng: np.random.Generator, half: float) -> Model:
    shapes = (box((-half, half), (-1.25, 1.25), (0.3, rng.uniform(2.9, 3.6))),)
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, 2 * half, 2.5, rng.uniform(60.0, 120.0))


def trailer(rng: np.random.Generator) -> Model:
    """Returns a low trailer."""
    half, top = rng.uniform(1.2, 2.2), rng.uniform(0.8, 2.0)
    shapes = (box((-half, half), (-0.85, 0.85), (0.4, top)),)
    return Model(SurfaceClass.LARGE_VEHICLE, shapes, 2 * half, 1.8, rng.uniform(30.0, 90.0))


def tree(rng: np.random.Generator) -> Model:
    """Returns a street tree whose crown leaves headroom for walking."""
    radius = rng.uniform(0.12, 0.24)
    blobs: list[Shape] = []
    for _ in range(int(rng.integers(3, 6))):
        size = rng.uniform(0.65, 1.15)
        offset = rng.uniform(-0.6, 0.6, size=2)
        blobs.append(sphere(offset[0], offset[1], 2.2 + size + rng.uniform(0.0, 1.2), size))
    trunk = cylinder(0.0, 0.0, radius, (0.0, 3.2))
    width = 2 * radius
    return Model(SurfaceClass.VEGETATION, (trunk, *blobs), width, width, rng.uniform(20.0, 45.0))


def hedge(rng: np.random.Generator) -> Model:
    """Returns 4 m of a clipped hedge along x with uneven sides."""
    height = rng.uniform(1.1, 1.8)
    shapes = [box((-2.0, 2.0), (-0.3, 0.3), (0.0, height))]
    for x in np.arange(-1.8, 1.9, 0.4).tolist():
        y, z, size = rng.uniform(-0.2, 0.2), rng.uniform(0.3, height), rng.uniform(0.2, 0.35)
        shapes.append(sphere(x + rng.uniform(-0.1, 0.1), y, z, size))
    return Model(SurfaceClass.VEGETATION, tuple(shapes), 4.0, 1.2, rng.uniform(20.0, 45.0))


def fence(rng: np.random.Generator) -> Model:
    """Returns 4 m of a fence along x: pickets on two rails, seen through between them."""
    height, gap = rng.uniform(0.9, 1.8), rng.uniform(0.25, 0.6)
    shapes = [box((-2.0, 2.0), (-0.03, 0.03), (z, z + 0.1)) for z in (0.25, height - 0.25)]
    shapes += [
        box((x - 0.05, x + 0.05), (-0.05, -0.03), (0.0, height))
        for x in np.arange(-2.0, 2.0, gap).tolist()
    ]
    return Model(SurfaceClass.STREET_FURNITURE, tuple(shapes), 4.0, 0.1, rng.uniform(30.0, 120.0))


def bank(rng: np.random.Generator) -> Model:
    """Returns 10 m of a grass bank along x that rises from the origin toward +y."""
    rise, half = rng.uniform(0.1, 0.5), rng.uniform(2.0, 6.0)
    slab = box((-5.0, 5.0), (0.0, 2 * half), (-1.0, 0.0))
    pose = tilt(0.0, rise) @ slab.body_from_shape
    shapes = (replace(slab, body_from_shape=pose),)
    return Model(SurfaceClass.SIDEWALK, shapes, 10.0, 4 * half, rng.uniform(30.0, 50.0))


def bollard(rng: np.random.Generator) -> Model:
    """Returns a bollard at the edge of a sidewalk."""
    radius = rng.uniform(0.05, 0.08)
    shapes = (cylinder(0.0, 0.0, radius, (0.0, rng.uniform(0.85, 1.0))),)
    return Model(SurfaceClass.STREET_FURNITURE, shapes, 2 * radius, 2 * radius, 60.0)


def lamp_post(rng: np.random.Generator) -> Model:
    """Returns a street lamp whose arm points along +x."""
    radius, height = rng.uniform(0.07, 0.11), rng.uniform(5.5, 7.0)
    shapes = (
        cylinder(0.0, 0.0, radius, (0.0, height)),
        box((0.0, 1.4), (-0.06, 0.06), (height - 0.15, height)),
    )
    return Model(SurfaceClass.POLE, shapes, 2 * radius, 2 * radius, rng.uniform(60.0, 90.0))


def sign(rng: np.random.Generator) -> Model:
    """Returns a traffic sign that faces along x; its plate shines back."""
    top = rng.uniform(2.3, 2.7)
    shapes = (
        cylinder(0.0, 0.0, 0.04, (0.0, top)),
        box((-0.015, 0.015), (-0.3, 0.3), (top - 0.62, top)),
    )
    return Model(SurfaceClass.POLE, shapes, 0.1, 0.6, rng.uniform(190.0, 240.0))


def litter_bin(rng: np.random.Generator) -> Model:
    """Returns a litter bin."""
    radius = rng.uniform(0.2, 0.28)
    shapes = (cylinder(0.0, 0.0, radius, (0.0, rng.uniform(0.8, 1.05))),)
    return Model(SurfaceClass.STREET_FURNITURE, shapes, 2 * radius, 2 * radius, 40.0)


def cabinet(rng: np.random.Generator) -> Model:
    """Returns a switch cabinet of the kind found beside sidewalks."""
    length, height = rng.uniform(0.6, 1.2), rng.uniform(0.9, 1.4)
    shapes = (box((-length / 2, length / 2), (-0.18, 0.18), (0.0, height)),)
    return Model(SurfaceClass.STREET_FURNITURE, shapes, length, 0.36, 85.0)


def bench(rng: np.random.Generator) -> Model:
    """Returns a bench; its back is on the +y side."""
    half = rng.uniform(0.75, 1.0)
    shapes = (
        box((-half, half), (-0.22, 0.18), (0.38, 0.46)),
        box((-half, half), (0.18, 0.24), (0.38, 0.85)),
        box((-half + 0.1, -half + 0.18), (-0.2, 0.2), (0.0, 0.38)),
        box((half - 0.18, half - 0.1), (-0.2, 0.2), (0.0, 0.38)),
    )
    return Model(SurfaceClass.STREET_FURNITURE, shapes, 2 * half, 0.5, 55.0)


def kerb(rng: np.random.Generator) -> Model:
    """Returns a kerb along x, low enough for a single beam."""
    half = rng.uniform(0.8, 5.0)
    shapes = (box((-half, half), (-0.15, 0.15), (0.0, rng.uniform(0.1, 0.22))),)
    return Model(SurfaceClass.SIDEWALK, shapes, 2 * half, 0.3, rng.uniform(30.0, 60.0))


def smooth_wall(rng: np.random.Generator) -> Model:
    """Returns 12 m of a wall along x of glass, tiles or metal."""
    shapes = (box((-6.0, 6.0), (-0.1, 0.1), (0.0, rng.uniform(0.5, 4.0))),)
    reflectivity, smoothness = rng.uniform(30.0, 90.0), 1.0 - 10.0 ** -rng.uniform(1.0, 3.0)
    return Model(SurfaceClass.BUILDING, shapes, 12.0, 0.2, reflectivity, smoothness)


def own_body(rng: np.random.Generator) -> Model:
    """Returns the visible parts of the vehicle with the lidar, in the lidar frame.

    That is two boxes behind it as in KITTI, or a roof and a mast as in `radiate_hdl32`.
    """
    boxes = [
        box((-1.2, -0.8), (side * 1.2 - 0.2, side * 1.2 + 0.2), (-0.75, -0.5)) for side in (-1, 1)
    ]
    below, side = -rng.uniform(0.2, 0.4), rng.choice([-1.0, 1.0])
    roof = box((-rng.uniform(1.5, 2.7), 0.5), (-0.6, 1.0), (below - 0.3, below))
    mast = cylinder(rng.uniform(-0.6, 0.3), 0.6 * side, rng.uniform(0.04, 0.2), (below, 0.4))
    seen = (boxes, [roof], [mast], [roof, mast])[int(rng.integers(4))]
    return Model(SurfaceClass.OWN_BODY, tuple(seen), 0.0, 0.0, 60.0)


def shelter(rng: np.random.Generator) -> Model:
    """Returns a bus shelter that opens toward -y."""
    half = rng.uniform(1.6, 2.2)
    shapes = (
        box((-half, half), (0.45, 0.5), (0.1, 2.2)),
        box((-half, -half + 0.05), (-0.3, 0.45), (0.1, 2.2)),
        box((half - 0.05, half), (-0.3, 0.45), (0.1, 2.2)),
        box((-half, half), (-0.5, 0.5), (2.2, 2.32)),
    )
    return Model(SurfaceClass.STREET_FURNITURE, shapes, 2 * half, 1.0, 70.0)


def house(rng: np.random.Generator, width_m: float) -> Model:
    """Returns a town house of `HOUSE_DEPTH_M` whose front faces -y; see `HOUSE_WALL_Y_M`.

    Pillars, a bay and a step stand up to `_PORCH_M` in front of the wall.
    """
    half, height, wall = width_m / 2, rng.uniform(6.0, 16.0), HOUSE_WALL_Y_M
    thick = rng.uniform(0.35, 0.6)
    shapes = [box((-half, half), (wall, wall + HOUSE_DEPTH_M), (0.0, height))]
    shapes += [
        box((center - thick / 2, center + thick / 2), (wall - 0.3, wall), (0.0, height))
        for center in np.linspace(-half + 0.6, half - 0.6, int(rng.integers(2, 5)))
    ]
    if width_m > 6.0:
        bay, floor = rng.uniform(-half + 1.0, half - 4.0), rng.uniform(2.6, 3.0)
        shapes.append(box((bay, bay + 3.0), (wall - _PORCH_M, wall), (floor, height - 0.8)))
        step = rng.uniform(-half + 1.0, half - 2.6)
        shapes.append(box((step, step + 1.6), (wall - 0.5, wall), (0.0, 0.3)))
    depth = HOUSE_DEPTH_M + _PORCH_M
    return Model(SurfaceClass.BUILDING, tuple(shapes), width_m, depth, rng.uniform(45.0, 120.0))


def shop(rng: np.random.Generator) -> Model:
    """Returns a shop of 9 m width whose windows face -y, 4.5 m before its middle."""
    depth, wall = 4.0, -4.5
    back, reflectivity = wall + depth, rng.uniform(45.0, 120.0)
    pane = box((-4.0, 4.0), (wall + 0.1, wall + 0.12), (0.5, 2.6))
    shapes = [
        box((-4.5, 4.5), (wall, wall + 0.3), (0.0, 0.5)),
        box((-4.5, 4.5), (wall, wall + 0.3), (2.6, 7.0)),
        box((-4.5, 4.5), (back, back + 0.2), (0.0, 7.0)),
        *(box((x - 0.25, x + 0.25), (wall, wall + 0.3), (0.5, 2.6)) for x in (-4.25, 0.0, 4.25)),
        replace(pane, is_glass=True),
    ]
    for x in np.arange(-3.6, 3.7, 1.2).tolist():
        y, height = rng.uniform(wall + 0.6, back - 0.4), rng.uniform(0.8, 1.9)
        shapes.append(box((x - 0.3, x + 0.3), (y - 0.15, y + 0.15), (0.0, height)))
    return Model(SurfaceClass.BUILDING, tuple(shapes), 9.0, 9.0, reflectivity)


def tunnel(rng: np.random.Generator) -> Model:
    """Returns 20 m of a tunnel along x, 12 m wide and 5 m high, with niche, lamps and cabinets."""
    niche = rng.uniform(-8.0, 6.0)
    shapes = [
        box((-10.0, niche), (6.0, 6.4), (0.0, 5.0)),
        box((niche, niche + 2.0), (6.8, 7.2), (0.0, 5.0)),
        box((niche + 2.0, 10.0), (6.0, 6.4), (0.0, 5.0)),
        box((-10.0, 10.0), (-6.4, -6.0), (0.0, 5.0)),
        box((-10.0, 10.0), (-7.0, 7.2), (5.0, 5.4)),
        *(box((x - 0.6, x + 0.6), (-0.2, 0.2), (4.7, 5.0)) for x in (-7.5, -2.5, 2.5, 7.5)),
    ]
    shapes += [
        box((x - 0.3, x + 0.3), (-6.0, -5.7), (0.0, rng.uniform(0.8, 2.0)))
        for x in rng.uniform(-9.5, 9.5, 3).tolist()
    ]
    return Model(SurfaceClass.BUILDING, tuple(shapes), 20.0, 14.4, rng.uniform(40.0, 60.0))


def shelf(rng: np.random.Generator) -> Model:
    """Returns a full shelf along x."""
    half, deep = rng.uniform(0.5, 1.5), rng.uniform(0.15, 0.3)
    shapes = (box((-half, half), (-deep, deep), (0.0, rng.uniform(1.8, 2.3))),)
    return Model(SurfaceClass.BUILDING, shapes, 2 * half, 2 * deep, rng.uniform(40.0, 100.0))


def table(rng: np.random.Generator) -> Model:
    """Returns a table: a top on four legs."""
    half, side, top = rng.uniform(0.4, 1.0), rng.uniform(0.3, 0.5), rng.uniform(0.7, 0.8)
    shapes = [box((-half, half), (-side, side), (top - 0.04, top))]
    shapes += [
        cylinder(x * (half - 0.06), y * (side - 0.06), 0.03, (0.0, top - 0.04))
        for x in (-1.0, 1.0)
        for y in (-1.0, 1.0)
    ]
    return Model(SurfaceClass.BUILDING, tuple(shapes), 2 * half, 2 * side, rng.uniform(40.0, 100.0))


def column(rng: np.random.Generator) -> Model:
    """Returns a column that reaches the ceiling of most rooms."""
    radius = rng.uniform(0.12, 0.3)
    shapes = (cylinder(0.0, 0.0, radius, (0.0, 6.0)),)
    return Model(SurfaceClass.BUILDING, shapes, 2 * radius, 2 * radius, rng.uniform(60.0, 110.0))
