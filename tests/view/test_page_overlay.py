# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the page shows over and beside the points, in a browser: legend, labels, keys, sizes."""

import base64
import io
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, PATIENCE_S, Browser
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
# What stands over the street, each a box of its own.
STANDING = (
    "[...document.querySelectorAll('header, nav .switch, #words, #player > *, aside')]"
    ".map((one) => one.getBoundingClientRect()).filter(({ width }) => width)"
    ".map(({ left, top, right, bottom }) => [left, top, right, bottom])"
)
LIT = "[...document.querySelectorAll('nav .on[id]')].map(({ id }) => id).join()"


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


def num_covered(browser: Browser) -> int:
    """Pixels of labels that are under title or buttons."""
    boxes, overlay = browser.value(f"[{BOXES}, {OVERLAY}]")
    with Image.open(io.BytesIO(base64.b64decode(overlay.partition(",")[2]))) as image:
        is_label = np.asarray(image)[..., 3] == LABEL_ALPHA
    assert is_label.sum() > 5_000  # a few labels
    assert len(boxes) == 2
    return sum(
        int(is_label[top:bottom, left:right].sum())
        for left, top, right, bottom in np.asarray(boxes).astype(int)
    )


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
    # Words that get longer are drawn around in the next frame.
    give_up_s = time.monotonic() + PATIENCE_S
    while num_covered(browser) and time.monotonic() < give_up_s:
        time.sleep(0.05)
    assert num_covered(browser) == 0


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_stands_over_anything_else(
    server: PageServer, browser: Browser, width: int
) -> None:
    browser.show_as(width, 780, "light")
    show_layer(server, "estimate")
    server.refuse("objects.max_speed_m_s: got 999, expected at most 100: " * 3)
    browser.until("!document.querySelector('#player').hidden")
    for _ in range(2):
        boxes = np.asarray(browser.value(STANDING))
        apart = (boxes[:, None, 2:] <= boxes[None, :, :2] + 1).any(axis=2)
        assert (apart | apart.T | np.eye(len(boxes), dtype=bool)).all()
        assert boxes.min() >= 0
        assert boxes[:, 2].max() <= width
        assert boxes[:, 3].max() <= 780
        browser.press("p")


def test_lost_ego_motion_is_said_in_red_while_it_lasts(
    server: PageServer, browser: Browser
) -> None:
    shown = "!document.querySelector('#lost').hidden"
    show_layer(server, "estimate")
    for lost in ("clouds repeat", "", "many objects share one motion"):
        server.tell("status", latency=1.0, values={}, warnings=[], lost=lost)
        browser.until(f"({shown}) === {'true' if lost else 'false'}")
    text = browser.value("document.querySelector('#lost').innerText")
    assert text.startswith("Ego motion lost: many objects share one motion.")
    x, y = browser.value(
        "(({left, top}) => [left + 5, top + 5])"
        "(document.querySelector('#lost').getBoundingClientRect())"
    )
    red, green, blue = browser.picture()[int(y), int(x)].tolist()
    assert red > 2 * max(green, blue)
    assert not browser.errors


def test_keys_work_after_a_click_on_the_time_bar(server: PageServer, browser: Browser) -> None:
    show_layer(server, "estimate")
    browser.until("!document.querySelector('#player').hidden")
    browser.until(f"{LIT} === 'orbit,follow,fold'")
    assert browser.press("t", on="#time")
    browser.until(f"{LIT} === 'top,follow,fold'")
    assert browser.press("ArrowRight", on="#time")
    assert server.commands.get_nowait() == {"do": "joined"}
    assert server.commands.get(timeout=60) == {"do": "step", "by": 1}
    # Fields have their own keys.
    assert not browser.press("t", on="#filter")
    assert not browser.press(" ", on="#play")
    is_open = "document.querySelector('#keys').open"
    assert browser.press("?")
    assert browser.value(is_open)
    assert "play or pause" in browser.value("document.querySelector('#keys').innerText")
    assert not browser.press("t")
    browser.press("?")
    assert not browser.value(is_open)
    assert browser.press("p")
    browser.until(f"{LIT} === 'top,follow'")
    assert not browser.errors


def test_the_page_is_light_or_dark_as_the_system_is(server: PageServer, browser: Browser) -> None:
    corner = np.s_[200:230, 5:35]
    for scheme, is_light in (("light", True), ("dark", False), ("light", True)):
        browser.show_as(1000, 640, scheme)
        browser.until(f"matchMedia('(prefers-color-scheme: {scheme})').matches")
        # The browser may show a frame a little after the page has drawn it.
        pictures = (browser.picture() for _ in range(50))
        assert any((each[corner] > 128).all() == is_light for each in pictures)


def test_a_page_without_a_sweep_says_what_it_waits_for(
    server: PageServer, browser: Browser
) -> None:
    waiting = "document.querySelector('#waiting')"
    server.tell("waiting", text="waiting for /flow: no sweep on /points")
    browser.until(f"{waiting}.textContent.includes('no sweep on /points')")
    show_objects(server, np.empty((0, 3)))
    browser.until(f"{waiting}.hidden")
