# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rules that are taken out one at a time."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest


@pytest.fixture
def rules(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("rules")


def test_each_rule_is_where_it_is_taken_out_and_comes_back(rules):
    changes = {rule: change for rule, change in rules.RULES.items() if change is not None}
    for rule, (target, name, other) in changes.items():
        before = getattr(target, name)
        with rules.without(rule):
            assert getattr(target, name) is other
        assert getattr(target, name) == before
