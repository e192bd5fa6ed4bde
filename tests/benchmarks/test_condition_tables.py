# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Figures of the conditions of adverse worlds."""

import math
from dataclasses import replace

import pytest


@pytest.fixture(scope="module")
def scores(load, tmp_path_factory):
    """A world without conditions, and the same world whose lidar sees its own roof."""
    drives, world_score = load("drives"), load("world_scores").world_score
    folder = tmp_path_factory.mktemp("worlds")
    kept = [drives.kept_world(2006, 0.8, "adverse", folder, name) for name in ("jitter", "body")]
    assert len(list(folder.iterdir())) == 2
    return [world_score(world, "adverse") for world in kept]


def test_an_own_body_that_is_called_a_mover_is_counted(scores):
    assert math.isnan(scores[0].figures["own body moves"])
    assert 0.0 <= scores[1].figures["own body moves"] <= 1.0


def test_each_condition_has_a_row_and_drawn_ones_have_targets(load, scores):
    """World 2006 draws body and wet."""
    without, body = scores
    half, all_ = (replace(body, figures=body.figures | {"own body moves": n}) for n in (0.5, 1.0))
    worst = replace(body, figures=body.figures | {"false movers": 2.0})
    by_name = {"none": [without], "drawn": [worst], "body": [half, all_]}
    table, targets = load("conditions").condition_tables(by_name)
    assert [row[:2] for row in table.rows] == [
        ["none", "1"],
        ["drawn", "1"],
        ["with body", "1"],
        ["body alone", "2"],
        ["with wet", "1"],
    ]
    assert [row[3] for row in table.rows[::3]] == ["", "0.75 of 2"]
    assert table.rows[1][2] == "2.000/2.000/2.000"
    assert targets.rows[0][2:] == ["2", "MISSED"]
