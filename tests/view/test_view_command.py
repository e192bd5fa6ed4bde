# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf view` in a browser: the page plays, steps, changes parameters and explains."""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser, served

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_topics import jazzy
from mnsf_ros.recording.bag_writer import BagWriter

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
CLOCK = "document.querySelector('#clock').textContent"
STAMP = "document.body.dataset.stamp"
KNOB = "document.getElementById('objects.max_speed_m_s')"


@pytest.fixture
def street(make_street: Callable[..., Path]) -> Path:
    return make_street(seed=0, duration_s=1.5, num_beams=32, num_columns=512)


@needs_chromium
@pytest.mark.slow
def test_a_recording_is_played_stepped_and_changed_on_the_page(
    street: Path, tmp_path: Path
) -> None:
    with served(str(street)) as url, Browser(url, tmp_path) as browser:
        browser.until(STAMP)
        street_part = np.s_[80:560, :640]
        seen = browser.picture()[street_part]
        assert np.ptp(seen.reshape(-1, 3).max(axis=1)) > 100
        first = browser.value(STAMP)
        browser.until(f"{STAMP} !== '{first}'")
        # The browser may show a frame a little after the page has drawn it.
        later = (browser.picture()[street_part] for _ in range(50))
        assert any((each != seen).any(axis=2).sum() > 500 for each in later)

        browser.click("#play")
        browser.until("document.querySelector('#play path').getAttribute('d').startsWith('M4')")
        browser.seek(0.7)
        browser.until(f"{CLOCK}.startsWith('0.7 /') && {STAMP}.endsWith('0.800')")
        before = browser.value(STAMP)
        browser.click("#next")
        browser.until(f"{CLOCK}.startsWith('0.8 /')")
        browser.click("#back")
        browser.until(f"{CLOCK}.startsWith('0.7 /') && {STAMP} === '{before}'")

        count = "Number(document.querySelectorAll('#status dd')[1].textContent)"
        usual = browser.until(count)
        browser.value(f"{KNOB}.value = 1; {KNOB}.onchange()")
        browser.until(f"{count} < {usual} && {STAMP} === '{before}'")
        assert "changes (1)" in browser.value("document.querySelector('#save').textContent")
        browser.click("#reset")
        browser.until(f"{count} === {usual}")

        browser.click("#layers button:nth-child(3)")
        browser.until("document.querySelector('#layers .on').textContent === 'error'")
        browser.until("document.body.dataset.layer === 'error'")
        selection = "document.querySelector('#selection').textContent"
        browser.click_at(330, 400)
        browser.until(f"{selection}.includes('Decided by the stage')")
        assert browser.press("n")
        browser.until(f"{selection}.includes('Object')")
        # The browser keeps its own keys.
        assert not browser.press("f", ctrlKey=True)
        assert not browser.errors


@needs_chromium
@pytest.mark.slow
def test_flow_of_a_node_and_its_parameters_are_on_the_page(
    street: Path, tmp_path: Path, own_domain: None
) -> None:
    pytest.importorskip("rclpy")

    @contextmanager
    def started(*words: str) -> Iterator[None]:
        command = [sys.executable, "-m", *words]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            try:
                yield
            finally:
                process.kill()

    with served() as url, Browser(url, tmp_path) as browser:
        warning = "document.querySelector('#status li')?.textContent"
        browser.until(f"{warning}?.includes('does not run')")
        with started("mnsf_ros.node", "--ros-args", "-r", "~/points:=/points"):
            browser.until(f"{KNOB}?.value === '36'")
            browser.value(f"{KNOB}.value = 20; {KNOB}.onchange()")
            browser.until("document.querySelector('#save').textContent.includes('(1)')")
            browser.value(f"{KNOB}.value = 999; {KNOB}.onchange()")
            browser.until("document.querySelector('#notice').textContent.includes('999')")
            browser.until(f"{warning}?.includes('no sweep')")
            # At a pace that a busy machine follows: it would drop sweeps, and show none.
            paced = ("play", str(street), "--wait", "--loop", "--rate", "0.2")
            with started("mnsf_ros.cli", *paced):
                browser.until(STAMP)
                browser.until("document.querySelector('#status').textContent.includes('out')")
                browser.click_at(330, 400)
                browser.until(
                    "document.querySelector('#selection').textContent.includes('Called dynamic')"
                )
        assert not browser.errors


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs the command and returns the one line that it ends with."""

    def run_refused(*arguments: str) -> str:
        assert run(["view", *arguments]) == EXIT_USAGE
        (line,) = capsys.readouterr().err.splitlines()
        return line

    return run_refused


def test_what_cannot_be_shown_is_one_line(
    street: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    with BagWriter(tmp_path / "empty") as writer:
        empty = jazzy().types["std_msgs/msg/String"](data="no cloud")
        raw = bytes(jazzy().serialize_cdr(empty, "std_msgs/msg/String"))
        writer.write_raw("/words", "std_msgs/msg/String", 1, raw)
    assert "no topic of type sensor_msgs/msg/PointCloud2" in refused(str(tmp_path / "empty"))
    assert "nothing" in refused(str(tmp_path / "nothing"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert f"cannot serve on 127.0.0.1:{port}" in refused(str(street), "--port", port)
