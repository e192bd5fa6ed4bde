# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report in a real browser: it renders, complains about nothing, and fetches nothing."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess

import pytest
from small_runs import kept, rows, run_record, write_run_report

from mnsf_ros.report.run_results import results_of

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")]


def browse(tmp_path, page, *options):
    """What the browser says on both outputs."""
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    flags += ["--disable-component-update", "--no-first-run", "--enable-logging=stderr", "--v=0"]
    flags += [f"--user-data-dir={tmp_path / 'profile'}", *options, page.as_uri()]
    return subprocess.run(
        [BROWSER, *flags], capture_output=True, text=True, timeout=300, check=True
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    results = results_of(run_record(), rows())
    return write_run_report(tmp_path_factory.mktemp("page"), results, kept())


def requested(net_log):
    """Addresses that pages asked for, from Chromium's own log of its network."""
    log = json.loads(net_log.read_text())
    urls = {event.get("params", {}).get("url", "") for event in log["events"]}
    return {url for url in urls if url.startswith(("http:", "https:", "ws:"))}


def test_page_renders_without_complaints_and_requests(tmp_path, page):
    net_log = tmp_path / "net.json"
    shown = browse(tmp_path, page, "--dump-dom", f"--log-net-log={net_log}")
    assert "CONSOLE" not in shown.stderr
    assert "Scene flow of street" in shown.stdout
    assert shown.stdout.rstrip().endswith("</html>")
    # The browser's own business (updates, accounts) is none of the page's.
    own = ("google", "gstatic", "googleapis", "gvt1")
    assert [url for url in requested(net_log) if not any(name in url for name in own)] == []


def test_a_broken_page_would_be_noticed(tmp_path, page):
    text = page.read_text().replace("</main>", '<img src="http://127.0.0.1:9/x.png"></main>')
    broken = tmp_path / "broken.html"
    broken.write_text(text)
    assert "CONSOLE" in browse(tmp_path, broken, "--dump-dom").stderr


def test_long_name_does_not_run_off_the_page(tmp_path):
    from matplotlib.image import imread

    name, picture = "n" * 150, tmp_path / "page.png"
    run = run_record()
    run = dataclasses.replace(run, recordings=[dataclasses.replace(run.recordings[0], name=name)])
    found = [dataclasses.replace(item, recording=name) for item in rows()]
    flows = [dataclasses.replace(flow, recording=name) for flow in kept()]
    path = write_run_report(tmp_path, results_of(run, found), flows)
    browse(tmp_path, path, "--hide-scrollbars", "--window-size=700,6000", f"--screenshot={picture}")
    margin = imread(picture)[:, -12:, :3]
    assert (margin == margin[:, :1]).all(), "there is nothing in the margin on the right"
