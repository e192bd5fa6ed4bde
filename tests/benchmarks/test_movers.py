# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`make benchmark-movers`: scores of a street, and targets."""

from __future__ import annotations

from dataclasses import replace

import pytest


@pytest.fixture
def rows(load):
    sweeps = load("drives").simulated_sweeps(0, 5, num_beams=16, num_columns=300)
    return list(load("movers").scored("street", "street 0", sweeps, range(1, 4)))


def test_a_street_is_scored_sweep_by_sweep(rows):
    assert [row.number for row in rows] == [1, 2, 3]
    assert all(row.errors["static"].epe_m < 0.05 for row in rows)
    assert {item.kind for row in rows for item in row.movers.objects} - {"unknown"}


def test_real_drive_and_streets_have_a_row_each(load, rows):
    movers = load("movers")
    kitti = [replace(row, method=movers.KITTI, recording="drive") for row in rows]
    main, groups, missed = movers.tables("reported", [*kitti, *rows])
    assert [row[0] for row in main.rows] == [movers.KITTI, movers.WORLDS]
    assert [row[0] for row in groups.rows] == [movers.KITTI, "street"]
    assert main.rows[0][1:] == groups.rows[0][1:]
    num_judged = int(main.title.split(" of ")[1].split()[0])
    assert f"{num_judged - len(missed.rows)} of {num_judged} targets met" in main.title


def test_only_kitti_has_a_target_for_its_dynamic_error(load, rows):
    movers = load("movers")
    for name, known in (("street", False), (movers.KITTI, True)):
        summary = movers.summarize([replace(row, method=name) for row in rows]).loc[name]
        names = {target.name for target in movers.targets(summary)}
        assert ("dynamic EPE (m)" in names) is known
        assert "precision of dynamic points (%)" in names
