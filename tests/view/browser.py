# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A headless Chromium, driven by its DevTools protocol."""

import base64
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image
from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
# WebGL without a graphics card, nothing but this machine, and none of the browser's own errands.
OPTIONS = (
    "--headless=new",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--remote-debugging-port=0",
)
# It draws without a graphics card.
PATIENCE_S = 180.0


@contextmanager
def served(*arguments: str) -> Iterator[str]:
    """`mnsf view` on a free port of this computer; the address of its page."""
    words = [sys.executable, "-m", "mnsf_ros.cli", "view", *arguments, "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as view:
        lines = []
        try:
            for line in view.stderr:
                lines.append(line)
                if match := re.match(r"open (http://127.0.0.1:\d+/) in a browser", line):
                    yield match[1]
                    break
            else:
                raise AssertionError(lines)
        finally:
            view.kill()


class Browser:
    """One page; a context manager. `errors` are the uncaught ones of its scripts."""

    def __init__(self, url: str, folder: Path, size: tuple[int, int] = (1000, 640)) -> None:
        sandbox = ["--no-sandbox"] if os.getuid() == 0 else []
        window = f"--window-size={size[0]},{size[1]}"
        profile = folder / "profile"
        self._process = subprocess.Popen(
            [CHROMIUM, *OPTIONS, *sandbox, window, f"--user-data-dir={profile}", "about:blank"],
            stderr=subprocess.DEVNULL,
        )
        self._numbers = itertools.count(1)
        self.errors: list[str] = []
        try:
            port, path = self._until_told(profile / "DevToolsActivePort")
            self._socket = connect(f"ws://127.0.0.1:{port}{path}", max_size=None)
            self._session = None
            (target,) = (
                one["targetId"]
                for one in self._call("Target.getTargets")["targetInfos"]
                if one["type"] == "page"
            )
            attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
            self._session = attached["sessionId"]
            self._call("Runtime.enable")
            self._call("Page.navigate", url=url)
            self.until("location.href !== 'about:blank' && document.readyState === 'complete'")
        except BaseException:
            self._process.kill()
            raise

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._process.kill()
        self._process.wait()

    def value(self, script: str):
        """The value of an expression in the page."""
        found = self._call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, script: str):
        """Waits for an expression to be true; returns its value."""
        give_up_s = time.monotonic() + PATIENCE_S
        while not (value := self.value(script)):
            assert time.monotonic() < give_up_s, (script, self.errors)
            time.sleep(0.05)
        return value

    def click(self, selector: str) -> None:
        self.value(f"document.querySelector({selector!r}).click()")

    def click_at(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def show_as(self, width: int, height: int, scheme: str) -> None:
        """Changes the size of the window, and the system to `light` or `dark`."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **size)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self._call("Emulation.setEmulatedMedia", features=features)

    def seek(self, position_s: float) -> None:
        # In one: what the player tells in between would move the bar back.
        bar = "document.querySelector('#time')"
        self.value(f"{bar}.value = {position_s}, {bar}.onchange()")

    def press(self, key: str, *, on: str = "body", **options: object) -> bool:
        """Presses a key on an element of the page; whether the page has used it."""
        event = json.dumps({"key": key, "bubbles": True, "cancelable": True} | options)
        element = f"document.querySelector({on!r})"
        return not self.value(f"{element}.dispatchEvent(new KeyboardEvent('keydown', {event}))")

    def picture(self) -> np.ndarray:
        """The page as it is seen, (H, W, 3)."""
        shot = self._call("Page.captureScreenshot", format="png")
        with Image.open(io.BytesIO(base64.b64decode(shot["data"]))) as image:
            return np.asarray(image.convert("RGB"))

    def _until_told(self, file: Path) -> tuple[str, str]:
        give_up_s = time.monotonic() + PATIENCE_S
        while not file.exists() or len(file.read_text().splitlines()) < 2:
            assert self._process.poll() is None
            assert time.monotonic() < give_up_s
            time.sleep(0.05)
        port, path = file.read_text().splitlines()
        return port, path

    def _call(self, method: str, **parameters):
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(answer["params"]))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
