# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording under the control of viewers: positions, layers, parameters, reasons."""

import json
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest
from box_street import BoxStreet, pose, unrelated_sweep
from websockets.sync.client import connect

from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import Settings
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.recording_view import RecordingView
from msg_utils.point_cloud2 import encode_columns

PATIENCE_S = 120.0


class Viewer:
    """A viewer of a recording, paused at its beginning, with the newest message of each kind."""

    def __init__(self, view: RecordingView, server: PageServer, address: str) -> None:
        self._server, self._view, self._is_over = server, view, False
        self._socket = connect(f"ws://{urlsplit(address).netloc}/socket", max_size=None)
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()
        self.newest: dict[str, dict] = {}
        self.send(do="pause")
        self.until(lambda: {"scene", "refused"} & {*self.newest} and self._is_quiet())

    def _run(self) -> None:
        while not self._is_over:
            self._view.work()

    def send(self, **command: object) -> None:
        self.newest.pop("player", None)
        self._socket.send(json.dumps(command))

    def until(self, condition: Callable[[], object]) -> None:
        give_up_s = time.monotonic() + PATIENCE_S
        while "player" not in self.newest or not condition():
            assert time.monotonic() < give_up_s, self.newest.get("player")
            try:
                raw = self._socket.recv(timeout=0.05)
            except TimeoutError:
                continue
            message = json.loads(raw) if isinstance(raw, str) else scene_of(raw)
            self.newest[message["kind"]] = message

    def _is_quiet(self) -> bool:
        return not self.newest["player"]["playing"] and self.newest["player"]["busy"] is None

    def sees(self, position_s: float) -> bool:
        at = self.newest["player"]["position"]
        return at == pytest.approx(position_s, abs=0.01) and self._is_quiet()

    def close(self) -> None:
        self._is_over = True
        self._server.commands.put({"do": "nothing"})
        self._thread.join()
        self._socket.close()


def scene_of(raw: bytes) -> dict:
    (length,) = struct.unpack_from("<I", raw)
    scene = json.loads(raw[4 : 4 + length])
    count = scene["numPoints"]
    start = 4 + length
    scene["xyz"] = np.frombuffer(raw, "<f4", 3 * count, start).reshape(-1, 3)
    scene["colors"] = np.frombuffer(raw, "<u4", count, start + 12 * count)
    assert len(raw) == start + 16 * count
    return scene | {"kind": "scene"}


@pytest.fixture
def viewing(make_street: Callable[..., Path]) -> Iterator[Callable[..., Viewer]]:
    street = make_street(seed=0, duration_s=1.5, num_beams=32, num_columns=512)
    server = PageServer()
    with BagReader(street) as reader, server.listening("127.0.0.1", 0) as address:
        opened: list[Viewer] = []

        def view(settings: Settings | None = None) -> Viewer:
            topics = used_topics(street, reader.topics)
            one = RecordingView(server, reader, topics, settings or preset("online"))
            opened.append(Viewer(one, server, address))
            return opened[-1]

        yield view
        for one in opened:
            one.close()


def test_positions(viewing) -> None:
    viewer = viewing()
    stamp = viewer.newest["scene"]["stamp"]
    first_s = viewer.newest["player"]["position"]
    viewer.send(do="step", by=1)
    viewer.until(lambda: viewer.sees(first_s + 0.1))
    assert viewer.newest["scene"]["stamp"] == f"{float(stamp) + 0.1:.3f}"
    viewer.send(do="step", by=-1)
    viewer.until(lambda: viewer.sees(first_s) and viewer.newest["scene"]["stamp"] == stamp)
    viewer.send(do="seek", to=1.0)
    viewer.until(lambda: viewer.sees(1.0))
    objects = viewer.newest["scene"]["objects"]
    viewer.send(do="step", by=-1)
    viewer.until(lambda: viewer.sees(0.9))
    viewer.send(do="step", by=1)
    viewer.until(lambda: viewer.sees(1.0))
    assert viewer.newest["scene"]["objects"] == objects
    # A step counts from the sweep that is on its way; it was lost.
    viewer.send(do="seek", to=0.5)
    viewer.send(do="step", by=1)
    viewer.until(lambda: viewer.sees(0.6))
    viewer.send(do="seek", to=1e9)
    viewer.until(lambda: viewer.newest["player"]["position"] < 0.2)


def test_layers(viewing) -> None:
    viewer = viewing()
    viewer.send(do="seek", to=1.0)
    viewer.until(lambda: viewer.sees(1.0))
    seen = {"estimate": viewer.newest["scene"]["colors"]}
    for name in ("truth", "error"):
        viewer.newest.pop("scene")
        viewer.send(do="layer", name=name)
        viewer.until(lambda: "scene" in viewer.newest)
        seen[name] = viewer.newest["scene"]["colors"]
    large = {name: colors >> 24 == 1 for name, colors in seen.items()}
    assert 0 < large["truth"].sum() < 0.2 * len(large["truth"])
    # Most of what is dynamic is found, and its colour is right.
    both = large["truth"] & large["estimate"]
    assert both.sum() > 0.7 * large["truth"].sum()
    red, green, blue = (
        (seen["estimate"][both] >> shift & 0xFF).astype(int)
        - (seen["truth"][both] >> shift & 0xFF).astype(int)
        for shift in (16, 8, 0)
    )
    assert np.median(np.abs(red) + np.abs(green) + np.abs(blue)) < 60


def test_a_parameter_holds_for_the_sweep_that_is_shown(viewing) -> None:
    viewer = viewing()
    viewer.send(do="seek", to=1.0)
    viewer.until(lambda: viewer.sees(1.0))
    usual = viewer.newest["scene"]
    assert usual["objects"]
    viewer.send(do="set", name="objects.max_speed_m_s", value=1.0)
    # At first the sweep alone, then with all before it.
    viewer.until(lambda: viewer.newest["scene"]["objects"] != usual["objects"])
    assert viewer.newest["player"]["busy"] is not None
    viewer.until(lambda: viewer.sees(1.0))
    changed = viewer.newest["scene"]
    assert changed["stamp"] == usual["stamp"]
    assert all(item["speed"] < 2 for item in changed["objects"])
    knobs = viewer.newest["knobs"]
    assert knobs["changed"] == ["objects.max_speed_m_s"]
    assert "max_speed_m_s: 1.0" in knobs["file"]
    viewer.send(do="reset")
    viewer.until(lambda: viewer.sees(1.0) and viewer.newest["scene"]["objects"] == usual["objects"])
    assert not viewer.newest["knobs"]["changed"]
    viewer.send(do="set", name="crop.max_range_m", value=15.0)
    viewer.until(lambda: viewer.sees(1.0) and viewer.newest["scene"]["objects"] != usual["objects"])
    # One that was seen may have gone on without points.
    seen = [item for item in viewer.newest["scene"]["objects"] if item["points"]]
    assert all(np.hypot(*item["center"][:2]) < 18 for item in seen)


def test_settings_without_any_flow_are_told_and_can_be_taken_back(viewing) -> None:
    viewer = viewing()
    viewer.send(do="set", name="buffer.max_interval_s", value=0.05)
    viewer.until(lambda: "no sweep has a flow" in viewer.newest.get("refused", {}).get("text", ""))
    viewer.newest.pop("scene")
    viewer.send(do="reset")
    viewer.until(lambda: "scene" in viewer.newest and viewer.sees(0.0))


def test_a_recording_without_any_flow_says_why(viewing, caplog) -> None:
    viewer = viewing(preset("online").changed({"buffer.max_interval_s": 0.05}))
    text = viewer.newest["refused"]["text"]
    assert text.startswith("no sweep has a flow with these settings: three sweeps in a row")
    assert text.endswith("at most 0.05 s apart")
    assert text in caplog.text


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("objects.max_speed_m_s", -1),
        ("objects.max_speed_m_s", "fast"),
        ("nothing", 1),
        ("method.name", "fnsf"),
        ("crop.max_range_m", None),
        ("crop.max_height_m", -30),
    ],
)
def test_a_value_that_does_not_fit_is_refused(viewing, name: str, value: object) -> None:
    viewer = viewing()
    viewer.send(do="set", name=name, value=value)
    viewer.until(lambda: "refused" in viewer.newest)
    assert name.partition(".")[0] in viewer.newest["refused"]["text"]
    viewer.until(lambda: viewer.newest["knobs"]["changed"] == [])


def test_reasons_for_an_object_and_for_a_place(viewing) -> None:
    viewer = viewing()
    viewer.send(do="seek", to=1.0)
    viewer.until(lambda: viewer.sees(1.0))
    item = max(viewer.newest["scene"]["objects"], key=lambda one: one["points"])
    viewer.send(do="explain", at=item["center"][:2], track=item["id"])
    viewer.until(lambda: viewer.newest["reasons"]["lines"])
    assert any("dynamic" in line for line in viewer.newest["reasons"]["lines"])
    viewer.send(do="explain", at=[5000, 0], track=0)
    viewer.until(lambda: "no point within" in viewer.newest["reasons"]["lines"][0])
    viewer.send(do="forget")
    viewer.until(lambda: viewer.newest["reasons"]["lines"] == [])


def test_commands_that_make_no_sense_change_nothing(viewing) -> None:
    viewer = viewing()
    before = viewer.newest["player"]
    for command in (
        {"do": "seek", "to": "far"},
        {"do": "seek", "to": float("nan")},
        {"do": "seek", "to": 10**400},
        {"do": "speed", "to": 0},
        {"do": "speed", "to": 10**400},
        {"do": "explain", "at": [10**400, 0], "track": 0},
        {"do": "explain", "at": [0, float("nan")], "track": 0},
        {"do": "explain", "at": [0, 0], "track": -(10**400)},
        {"do": "set", "name": "crop.max_range_m", "value": 10**400},
        {"do": "set", "name": "crop.max_range_m", "value": {"a": []}},
        {"do": "step", "by": 10**9},
        {"do": "layer", "name": "nothing"},
        {"do": "explain", "at": [1], "track": 0},
        {"do": "set"},
        {"do": "dance"},
    ):
        viewer.send(**command)
        viewer.until(lambda: True)
        assert viewer.newest["player"] == before


def test_what_is_left_of_a_recording_is_seen(make_street, tmp_path: Path) -> None:
    (whole,) = make_street(seed=0, duration_s=1.5, num_beams=32, num_columns=512).glob("*.mcap")
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    server = PageServer()
    with BagReader(cut) as reader, server.listening("127.0.0.1", 0) as address:
        topics = used_topics(cut, reader.topics)
        viewer = Viewer(RecordingView(server, reader, topics, Settings()), server, address)
        viewer.close()


def test_nothing_is_done_while_nobody_watches(make_street) -> None:
    street = make_street(seed=0, duration_s=1.5, num_beams=32, num_columns=512)
    server = PageServer()
    with BagReader(street) as reader:
        topics = used_topics(street, reader.topics)
        view = RecordingView(server, reader, topics, Settings())
        assert view._idle_s() is None


def test_lost_ego_motion_is_said_with_its_sweep(tmp_path: Path) -> None:
    """Its last sweeps are of another place."""
    street, lost = BoxStreet(), tmp_path / "lost"
    with BagWriter(lost) as writer:
        for index in range(8):
            xyz = street.xyz(pose(0.6 * index), seed=index)
            if index in (4, 5):
                xyz = unrelated_sweep(index).xyz
            columns = {axis: xyz[:, i].astype(np.float32) for i, axis in enumerate("xyz")}
            cloud = encode_columns(columns, 1, len(xyz))
            writer.write_cloud("/points", cloud, 10**9 + index * 10**8, "lidar")
    server = PageServer()
    with BagReader(lost) as reader, server.listening("127.0.0.1", 0) as address:
        topics = used_topics(lost, reader.topics)
        viewer = Viewer(RecordingView(server, reader, topics, preset("online")), server, address)
        said = []
        for number in range(1, 7):
            viewer.until(lambda number=number: viewer.sees(0.1 * (number - 1)))
            said.append(viewer.newest["status"]["lost"])
            viewer.send(do="step", by=1)
        viewer.close()
    reason = "the sweep does not match those before it"
    assert said == ["", "", *3 * [reason], ""]
