# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A node's messages on the page: scenes of one stamp, and only while somebody watches."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.sync.client import connect

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from ruamel.yaml import YAML
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.node.parameters import NodeParameters
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.recording.bag_topics import ODOMETRY_TYPE
from mnsf_ros.sweeps_io.flow_columns import object_columns
from mnsf_ros.view.node_view import NodeView
from mnsf_ros.view.page_server import PageServer
from msg_utils.cdr import serialized_cloud
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns

PATIENCE_S = 60.0
KNOB = "objects.max_speed_m_s"


@pytest.fixture
def address(own_domain: None) -> Iterator[str]:
    """Where the page of the node /front is, whose flow has another name."""
    server = PageServer()
    with (
        NodeView(server, "front", "moved/flow") as view,
        server.listening("127.0.0.1", 0) as address,
    ):
        is_over = False

        def run() -> None:
            while not is_over:
                view.work()

        thread = Thread(target=run, daemon=True)
        thread.start()
        yield address
        is_over = True
        server.commands.put({"do": "nothing"})
        thread.join()


class Front:
    """The outputs of a node."""

    def __init__(self, ros: RawTopics) -> None:
        self.ros = ros
        self.outputs = {
            name: ros.publisher(topic, msgtype)
            for name, topic, msgtype in (
                ("flow", "/moved/flow", CLOUD_TYPE),
                ("objects", "/front/objects", CLOUD_TYPE),
                ("ego_motion", "/front/ego_motion", ODOMETRY_TYPE),
            )
        }

    def until(self, condition: Callable[[], object]) -> None:
        give_up_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up_s
            self.ros.spin_for(0.05)

    def num_subscriptions(self) -> int:
        return sum(output.get_subscription_count() for output in self.outputs.values())

    def publish(self, stamp_s: int, *, without: str = "") -> None:
        header = Header(frame_id="lidar")
        header.stamp.sec = stamp_s
        columns = {axis: np.arange(1, 4, dtype=np.float32) for axis in "xyz"}
        columns |= {"dynamic": np.array([0, 1, 0], np.uint8)}
        columns |= {"rgb": np.array([1, 0xFF0000, 2], np.uint32).view(np.float32)}
        columns.pop(without, None)
        item = TrackedObject(
            7, np.ones(3), np.ones(3), 0.0, np.array([3.0, 4.0, 0.0]), 0.0, np.eye(6), 1.0, 1
        )
        place = Odometry(header=header)
        place.pose.pose.position.x, place.pose.pose.orientation.w = float(stamp_s), 1.0
        messages = {
            "flow": serialized_cloud(header, encode_columns(columns, 1, 3), is_dense=True),
            "objects": serialized_cloud(
                header, encode_columns(object_columns([item]), 1, 1), is_dense=True
            ),
            "ego_motion": serialize_message(place),
        }
        for name, raw in messages.items():
            if name != without:
                self.outputs[name].publish(raw)


@pytest.mark.usefixtures("own_domain")
def test_an_interruption_waits_for_the_end_of_a_callback() -> None:
    """Within one, rclpy makes it an error of another kind."""
    ended = []

    def callback(_: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        ended.append(True)

    with RawTopics("node_of_the_test") as ros:
        publisher = ros.publisher("/interrupted", ODOMETRY_TYPE)
        subscription = ros.subscribe("/interrupted", ODOMETRY_TYPE, callback)
        while publisher.get_subscription_count() == 0:
            ros.spin_for(0.05)
        publisher.publish(Odometry())
        with pytest.raises(KeyboardInterrupt):
            ros.spin_for(PATIENCE_S)
        assert subscription
    assert ended == [True]


def test_scenes_of_a_node_while_somebody_watches(address: str) -> None:
    with RawTopics("node_of_the_test") as ros:
        front = Front(ros)
        with closing(connect(f"ws://{urlsplit(address).netloc}/socket")) as viewer:

            def scene() -> dict:
                while isinstance(raw := viewer.recv(timeout=PATIENCE_S), str):
                    pass
                length = int.from_bytes(raw[:4], "little")
                found = json.loads(raw[4 : 4 + length])
                colors = np.frombuffer(raw, "<u4", 3, len(raw) - 12)
                assert colors.tolist() == [1, 0x1FF0000, 2]
                return found

            front.until(lambda: front.num_subscriptions() == 3)
            front.publish(10)
            seen = scene()
            assert seen["stamp"] == "10.000"
            assert seen["ego"][-1] == [10.0, 0.0, 0.0]
            assert (seen["objects"][0]["id"], seen["objects"][0]["speed"]) == (7, 5.0)
            # Clouds of others are left out; scenes without objects are shown late.
            front.publish(11, without="dynamic")
            front.publish(12, without="objects")
            front.publish(13, without="objects")
            assert scene()["stamp"] == "12.000"
            # A recording that starts again; topics have no order among each other.
            ros.spin_for(0.5)
            front.publish(5)
            seen = scene()
            assert (seen["stamp"], len(seen["objects"][0]["path"])) == ("5.000", 1)
        front.until(lambda: front.num_subscriptions() == 0)


def test_object_that_is_gone_is_asked_about_where_it_was(address: str) -> None:
    with RawTopics("node_of_the_test") as ros:
        front, asked = Front(ros), []
        ros.subscribe(
            "/front/explain",
            "geometry_msgs/msg/PointStamped",
            lambda message: asked.append((message.header.stamp.sec, message.point.x)),
        )
        with closing(connect(f"ws://{urlsplit(address).netloc}/socket")) as viewer:
            front.until(lambda: front.num_subscriptions() == 3)
            front.publish(10)
            viewer.send(json.dumps({"do": "explain", "at": [5, 5], "track": 7}))
            front.until(lambda: (10, 1.0) in asked)
            for stamp_s in (11, 12):
                front.publish(stamp_s, without="objects")
            front.until(lambda: (11, 1.0) in asked)


def test_own_body_of_a_node_is_shown_and_saved(address: str) -> None:
    with (
        RawTopics("front") as ros,
        closing(connect(f"ws://{urlsplit(address).netloc}/socket")) as viewer,
    ):
        NodeParameters(ros.node)
        publisher = ros.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        values = {"own body": "130 points within 2.1 m", "own body boxes": "-2.1 -1 0 0 1 0.5"}
        status = DiagnosticStatus(name="front: flow")
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        no_boxes = KeyValue(key="own body boxes", value="1 2; x")
        others = [DiagnosticStatus(name="front: flow", values=[no_boxes])]
        raw, bad = (serialize_message(DiagnosticArray(status=one)) for one in ([status], others))
        newest: dict[str, dict] = {}
        give_up_s = time.monotonic() + PATIENCE_S
        while not newest.get("knobs", {}).get("body"):
            assert time.monotonic() < give_up_s, newest.keys()
            publisher.publish(bad)
            publisher.publish(raw)
            ros.spin_for(0.05)
            with suppress(TimeoutError):
                while isinstance(text := viewer.recv(timeout=0), str):
                    message = json.loads(text)
                    newest[message["kind"]] = message
        knobs = newest["knobs"]
        assert knobs["body"] == [[-2.1, -1.0, 0.0, 0.0, 1.0, 0.5]]
        assert (knobs["changed"], knobs["saved"]) == ([], ["crop.own_body"])
        saved = YAML(typ="safe").load(knobs["file"])["/**"]["ros__parameters"]
        assert saved == {"crop": {"own_body": "-2.1 -1 0 0 1 0.5"}}


def test_lost_ego_motion_of_a_node_is_said_while_it_lasts(address: str) -> None:
    with (
        RawTopics("front") as ros,
        closing(connect(f"ws://{urlsplit(address).netloc}/socket")) as viewer,
    ):
        publisher = ros.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        error, ok = DiagnosticStatus.ERROR, DiagnosticStatus.OK
        for level, value, wanted in ((error, "clouds repeat", "clouds repeat"), (ok, "no", "")):
            status = DiagnosticStatus(name="front: ego motion", level=level, message="lost")
            status.values = [KeyValue(key="lost", value=value)]
            raw, lost = serialize_message(DiagnosticArray(status=[status])), None
            give_up_s = time.monotonic() + PATIENCE_S
            while lost != wanted:
                assert time.monotonic() < give_up_s
                publisher.publish(raw)
                ros.spin_for(0.05)
                with suppress(TimeoutError):
                    while isinstance(text := viewer.recv(timeout=0), str):
                        message = json.loads(text)
                        # Before that, the node itself is missing.
                        texts = {item["text"] for item in message.get("warnings", ())}
                        if message["kind"] == "status" and texts <= {"ego motion: lost"}:
                            lost = message["lost"]


def test_parameters_of_a_node_by_whomever_they_are_set(address: str) -> None:
    with (
        RawTopics("front") as ros,
        closing(connect(f"ws://{urlsplit(address).netloc}/socket")) as viewer,
    ):
        NodeParameters(ros.node)
        newest: dict[str, dict] = {}

        def until(condition: Callable[[], object]) -> None:
            give_up_s = time.monotonic() + PATIENCE_S
            while not (newest and condition()):
                assert time.monotonic() < give_up_s, newest.keys()
                ros.spin_for(0.05)
                with suppress(TimeoutError):
                    while message := json.loads(viewer.recv(timeout=0)):
                        newest[message["kind"]] = message

        def shown() -> float | None:
            knobs = [one for g in newest.get("knobs", {}).get("groups", []) for one in g["knobs"]]
            return next((one["value"] for one in knobs if one["name"] == KNOB), None)

        def set_knob(value: float) -> None:
            viewer.send(json.dumps({"do": "set", "name": KNOB, "value": value}))

        until(lambda: shown() == 36.0)
        set_knob(20)
        until(lambda: shown() == ros.node.get_parameter(KNOB).value == 20.0)
        ros.node.set_parameters([Parameter(KNOB, value=30.0)])
        until(lambda: shown() == 30.0)
        assert newest["knobs"]["changed"] == [KNOB]
        set_knob(999)
        until(lambda: "999" in newest.get("refused", {}).get("text", ""))
        viewer.send(json.dumps({"do": "reset"}))
        until(lambda: shown() == ros.node.get_parameter(KNOB).value == 36.0)
