# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the page draws over the points: legend and labels, in a browser."""

import base64
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from PIL import Image

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.scene_message import DrawnSweep, Trails, scene_message

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

OVERLAY = "document.querySelector('#overlay').toDataURL()"
BOXES = (
    "[...document.querySelectorAll('header, nav')].map((one) => one.getBoundingClientRect())"
    ".map(({left, top, right, bottom}) => [left, top, right, bottom])"
)
LABEL_ALPHA = 0xE0


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


def show_objects(server: PageServer, centers: np.ndarray) -> None:
    objects = [
        TrackedObject(number, at, np.full(3, 0.01), 0.0, np.zeros(3), 0.0, np.eye(6), 1.0, 1)
        for number, at in enumerate(centers, start=1)
    ]
    no_points = np.empty((0, 3), np.float32)
    scene = DrawnSweep(10**9, no_points, np.empty(0, np.uint32), np.eye(4), objects)
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
    show_objects(server, np.empty((0, 3)))
    browser.until("document.body.dataset.stamp")
    legend_of_motion = browser.value(OVERLAY)
    show_layer(server, "error")
    browser.until(f"{OVERLAY} !== '{legend_of_motion}'")
    show_layer(server, "truth")
    browser.until(f"{OVERLAY} === '{legend_of_motion}'")


def test_labels_keep_clear_of_title_and_buttons(server: PageServer, browser: Browser) -> None:
    show_layer(server, "estimate")
    # All over the upper part of the page.
    y, z = np.meshgrid(np.linspace(-25, 25, 21), np.linspace(4, 11, 8))
    show_objects(server, np.column_stack([np.full(y.size, 30.0), y.ravel(), z.ravel()]))
    browser.until("document.body.dataset.stamp")
    png = base64.b64decode(browser.value(OVERLAY).partition(",")[2])
    with Image.open(io.BytesIO(png)) as image:
        is_label = np.asarray(image)[..., 3] == LABEL_ALPHA
    assert is_label.sum() > 5_000  # a few labels
    boxes = np.asarray(browser.value(BOXES)).astype(int)
    assert len(boxes) == 2
    for left, top, right, bottom in boxes:
        assert not is_label[top:bottom, left:right].any()
