# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the page draws over the points, in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser

from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.scene_message import Scene, Trails, scene_message

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

OVERLAY = "document.querySelector('#overlay').toDataURL()"


def show_layer(server: PageServer, layer: str) -> None:
    server.tell(
        "player",
        playing=False,
        layers=["estimate", "truth", "error"],
        layer=layer,
        speed=1.0,
        position=0.0,
        duration=1.0,
        busy=None,
    )


def show_an_empty_scene(server: PageServer) -> None:
    no_points = np.empty((0, 3), np.float32)
    scene = Scene(10**9, no_points, np.empty(0, np.uint32), np.eye(4), [])
    server.publish("scene", scene_message(scene, Trails([], {})))


@pytest.fixture
def server() -> PageServer:
    return PageServer()


@pytest.fixture
def browser(server: PageServer, tmp_path: Path) -> Iterator[Browser]:
    with server.listening("127.0.0.1", 0) as url, Browser(url, tmp_path) as browser:
        yield browser


def test_the_legend_follows_the_layer_without_a_new_scene(
    server: PageServer, browser: Browser
) -> None:
    show_layer(server, "estimate")
    show_an_empty_scene(server)
    browser.until("document.body.dataset.stamp")
    legend_of_motion = browser.value(OVERLAY)
    show_layer(server, "error")
    browser.until(f"{OVERLAY} !== '{legend_of_motion}'")
    show_layer(server, "truth")
    browser.until(f"{OVERLAY} === '{legend_of_motion}'")
