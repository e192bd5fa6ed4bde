# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A ROS domain for what a test starts."""

import os

import pytest


@pytest.fixture
def own_domain(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
