# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The arithmetic of nav2's ObstacleLayer, by its parameters and in its words.

Written after what nav2_costmap_2d documents of Jazzy's layer and its observation buffer: points
beyond the heights of their source are dropped; then each source that clears traces rays in the
plane from the sensor to its points; then each source that marks sets the cells of its points, by
the heights of the layer and the ranges of the source. Times, transforms and other layers are left
out: each source keeps its newest cloud.
"""

import numpy as np

LETHAL, FREE = 254, 0
# What nav2 declares where a file says nothing.
LAYER_DEFAULTS = {"min_obstacle_height": 0.0, "max_obstacle_height": 2.0}
SOURCE_DEFAULTS = {
    "marking": True,
    "clearing": False,
    "min_obstacle_height": 0.0,
    "max_obstacle_height": 0.0,
    "obstacle_min_range": 0.0,
    "obstacle_max_range": 2.5,
    "raytrace_min_range": 0.0,
    "raytrace_max_range": 3.0,
}


class ObstacleLayer:
    """A layer of a square map around the origin of its frame.

    Attributes:
        costs: (K, K) uint8, by x and y.
    """

    def __init__(self, parameters, *, resolution_m=0.05, size_m=40.0):
        self._parameters = LAYER_DEFAULTS | parameters
        self._resolution_m, self._half_m = resolution_m, size_m / 2
        number = round(size_m / resolution_m)
        self.costs = np.full((number, number), FREE, np.uint8)
        self._sources = {
            name: SOURCE_DEFAULTS | parameters[name]
            for name in parameters["observation_sources"].split()
        }
        self._observations = {}

    def observe(self, topic, xyz, origin):
        """Takes a cloud (N, 3) that was measured from a place (3,), both in the frame of the map.

        Returns whether any source listens to the topic.
        """
        names = [name for name, source in self._sources.items() if source["topic"] == topic]
        for name in names:
            source = self._sources[name]
            low, high = source["min_obstacle_height"], source["max_obstacle_height"]
            kept = (xyz[:, 2] >= low) & (xyz[:, 2] <= high)
            self._observations[name] = xyz[kept], np.asarray(origin)
        return bool(names)

    def update(self):
        """One cycle of the costmap."""
        for name, (xyz, origin) in self._observations.items():
            if self._sources[name]["clearing"]:
                self._clear(self._sources[name], xyz, origin)
        for name, (xyz, origin) in self._observations.items():
            if self._sources[name]["marking"]:
                self._mark(self._sources[name], xyz, origin)

    def cells(self, xy):
        """(N, 2) int, the cells of places; they may be outside of the map."""
        return np.floor((np.asarray(xy)[:, :2] + self._half_m) / self._resolution_m).astype(int)

    def _mark(self, source, xyz, origin):
        layer = self._parameters
        distances = np.linalg.norm(xyz - origin, axis=1)
        kept = (xyz[:, 2] >= layer["min_obstacle_height"]) & (
            xyz[:, 2] <= layer["max_obstacle_height"]
        )
        kept &= (distances < source["obstacle_max_range"]) & (
            distances >= source["obstacle_min_range"]
        )
        cells = self.cells(xyz[kept])
        inside = ((cells >= 0) & (cells < len(self.costs))).all(axis=1)
        self.costs[tuple(cells[inside].T)] = LETHAL

    def _clear(self, source, xyz, origin):
        """Bresenham lines from the cell of the sensor to those of the points, ends included."""
        start = self.cells(origin[None])[0]
        ways = np.unique(self.cells(xyz), axis=0) - start
        # Rays end at the border of the map, and at the range of the source.
        room = np.where(ways > 0, len(self.costs) - 1 - start, start)
        shares = np.min(room / np.maximum(np.abs(ways), 1), axis=1)
        lengths = np.hypot(*ways.T) * self._resolution_m
        shares = np.minimum(shares, source["raytrace_max_range"] / np.maximum(lengths, 1e-9))
        numbers = np.abs(ways).max(axis=1)
        first = source["raytrace_min_range"] / np.maximum(lengths, 1e-9) * numbers
        last = np.minimum(shares, 1.0) * numbers
        for step in range(int(last.max(initial=-1)) + 1):
            on = (step <= last) & (step >= first)
            places = start + np.floor(
                ways[on] * step / np.maximum(numbers[on], 1)[:, None] + 0.5
            ).astype(int)
            self.costs[tuple(places.T)] = FREE
