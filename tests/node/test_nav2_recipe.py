# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The costmap layers of docs/recipes.md, by the arithmetic of nav2 and the clouds of the node."""

from pathlib import Path

import numpy as np
import pytest
from nav2_layers import LETHAL, ObstacleLayer
from rclpy.serialization import deserialize_message
from ruamel.yaml import YAML
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from synthetic_clouds import column, tracked

from mnsf_ros.node.object_messages import cloud_of
from mnsf_ros.sweeps_io.predicted_ground import clearing_columns, predicted_columns

SENSOR = np.array([0.0, 0.0, 1.2])
PREDICTED, CLEARING = "/scene_flow/predicted", "/scene_flow/predicted/clearing"
# Of the crossing person, m/s, to the left of the robot.
SPEED = 1.5


def recipe(layer):
    """The parameters of a layer in docs/recipes.md."""
    text = (Path(__file__).parents[2] / "docs" / "recipes.md").read_text()
    blocks = (block.split("```")[0] for block in text.split("```yaml")[1:])
    (block,) = (block for block in blocks if f"      {layer}:\n" in block)
    parameters = YAML(typ="safe").load(block)
    while layer not in parameters:
        (parameters,) = parameters.values()
    return parameters[layer]


def xyz_of(columns):
    """The points of a cloud as it is published, in the frame of the map."""
    message = deserialize_message(cloud_of(Header(frame_id="lidar"), columns), PointCloud2)
    return np.stack([column(message, name) for name in "xyz"], axis=1) + SENSOR


def person_at(time_s):
    """A person who crosses 5 m ahead of the robot, from the right."""
    return tracked(
        center=np.array([5.0, -4.0 + SPEED * time_s, -0.3]),
        size=np.array([0.4, 0.5, 1.7]),
        velocity=np.array([0.0, SPEED, 0.0]),
        turn_rate=0.0,
        covariance=np.diag([0.01, 0.01, 0.01, 0.06, 0.06, 0.06]),
    )


class Crossing:
    """The layer of predicted ground while a person crosses."""

    def __init__(self, *topics):
        self.layer = ObstacleLayer(recipe("predicted_layer"))
        self._topics = topics

    def update(self, objects):
        clouds = {PREDICTED: predicted_columns(objects, 2.0), CLEARING: clearing_columns(None)}
        for topic in self._topics:
            assert self.layer.observe(topic, xyz_of(clouds[topic]), SENSOR)
        self.layer.update()

    def is_marked(self, x, y):
        """Whether a robot there would touch an obstacle, inflated by a cell of the ground."""
        cell_x, cell_y = self.layer.cells([[x, y]])[0]
        around = self.layer.costs[cell_x - 4 : cell_x + 5, cell_y - 4 : cell_y + 5]
        return (around == LETHAL).any()

    @property
    def marked(self):
        return np.argwhere(self.layer.costs == LETHAL)


def test_ground_is_marked_before_a_mover_comes_and_free_after_it_has_passed():
    crossing = Crossing(CLEARING, PREDICTED)
    for time_s in np.arange(0.0, 4.0, 0.4):
        crossing.update([person_at(time_s)])
        now = -4.0 + SPEED * time_s
        for ahead_s in (0.0, 0.5, 1.0, 1.5, 2.0):
            assert crossing.is_marked(5.0, now + SPEED * ahead_s)
        # Nothing behind, nothing further ahead, nothing elsewhere.
        assert not crossing.is_marked(5.0, now - 0.8)
        assert not crossing.is_marked(5.0, now + SPEED * 2.0 + 1.2)
        assert not crossing.is_marked(3.5, now)
    crossing.update([])
    assert len(crossing.marked) == 0


def test_without_the_ring_a_trail_stays():
    crossing = Crossing(PREDICTED)
    for time_s in np.arange(0.0, 4.0, 0.4):
        crossing.update([person_at(time_s)])
    crossing.update([])
    assert crossing.is_marked(5.0, -4.0)


@pytest.mark.parametrize("range_m", [1.0, 10.0, 24.9])
def test_the_ring_clears_every_cell_that_can_be_marked(range_m):
    layer = ObstacleLayer(recipe("predicted_layer"), size_m=60.0)
    around = np.linspace(0, 2 * np.pi, 5000)
    points = range_m * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1) + SENSOR
    layer.observe(PREDICTED, points, SENSOR)
    layer.update()
    assert (layer.costs == LETHAL).any()
    layer.observe(PREDICTED, points[:0], SENSOR)
    layer.observe(CLEARING, xyz_of(clearing_columns(None)), SENSOR)
    layer.update()
    assert not (layer.costs == LETHAL).any()


def test_static_points_mark_and_the_cloud_clears_the_global_costmap():
    layer = ObstacleLayer(recipe("obstacle_layer"))
    wall = np.stack(np.meshgrid([15.0], np.linspace(-1, 1, 50), [0.5, 1.0]), -1).reshape(-1, 3)
    layer.observe("/scene_flow/flow/standing", wall, SENSOR)
    layer.observe("/lidar/points", wall, SENSOR)
    layer.update()
    x, y = layer.cells(wall[:1])[0]
    assert layer.costs[x, y] == LETHAL
    # The wall was a van that has left: rays to the ground behind it free its place.
    ground = np.stack(np.meshgrid([19.0], np.linspace(-1.5, 1.5, 400), [0.0]), -1).reshape(-1, 3)
    layer.observe("/scene_flow/flow/standing", wall[:0], SENSOR)
    layer.observe("/lidar/points", ground, SENSOR)
    layer.update()
    assert not (layer.costs == LETHAL).any()
