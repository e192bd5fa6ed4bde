# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A running node on the page: its flow, its status, its parameters."""

from __future__ import annotations

import logging
from collections.abc import Callable
from queue import Empty
from typing import Any, Final, TypeVar

import numpy as np

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.errors import SettingsError, one_line
from mnsf_ros.geometry.transforms import pose_matrix
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.node.remote_parameters import RemoteParameters
from mnsf_ros.recording.ros1_file import jazzy
from mnsf_ros.settings import Settings, declared_setting, declared_settings
from mnsf_ros.sweeps.sweep import NANOSECONDS
from mnsf_ros.sweeps_io.flow_columns import COLOR_NAME
from mnsf_ros.view.commands import Asked
from mnsf_ros.view.knobs import knobs
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.scene_message import Paths, Scene, motion_colors, scene_message
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points, decode_xyz
from msg_utils.stamps import decode_stamp

_LOG = logging.getLogger(__name__)
_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
# Below the name of the node; together they are a scene.
_PARTS: Final = {
    "/flow": _CLOUD,
    "/objects": _CLOUD,
    "/ego_motion": "nav_msgs/msg/Odometry",
}
_LATENCY: Final = ("/debug/pipeline_latency_ms", "std_msgs/msg/Float64")
_QUESTIONS: Final = ("/explain", "geometry_msgs/msg/PointStamped")
_ANSWERS: Final = "/explanation"
_STATUSES: Final = "diagnostic_msgs/msg/DiagnosticArray"
_LEVELS: Final = {1: "warning", 2: "error", 3: "stale"}
# Key of a diagnostic status to its name on the page.
_VALUES: Final = {
    "latency median [ms]": "latency, median (ms)",
    "latency p95 [ms]": "latency, 95th percentile (ms)",
    "rate [Hz]": "flows a second",
    "flows_out": "flows out",
    "triplets_dropped": "dropped",
    "source": "ego motion",
}
_ROUND_S: Final = 0.05
_MAX_WAITING: Final = 5
_JUMP_NS: Final = 1_000_000_000  # back in time: a recording that starts again

Self = TypeVar("Self", bound="NodeView")


class NodeView:
    """Subscribes to a node while there are viewers; use it as a context manager."""

    def __init__(self, server: PageServer, node: str, flow: str | None = None) -> None:
        """Joins the ROS graph.

        Args:
            server: Has the viewers.
            node: Full name such as `/scene_flow`.
            flow: Topic of the flow, if it is not `flow` below that name.
        """
        self._server, self._name = server, f"/{node.strip('/')}"
        self._topics = {part: f"{self._name}{part}" for part in _PARTS}
        if flow is not None:
            self._topics["/flow"] = f"/{flow.strip('/')}"
        self._ros = RawTopics("mnsf_view")
        self._settings = Settings()
        self._parameters: RemoteParameters | None = None
        self._subscriptions: list[Any] = []
        self._questions = self._ros.publisher(f"{self._name}{_QUESTIONS[0]}", _QUESTIONS[1])
        self._asked: Asked | None = None
        self._is_there = True
        self._forget()
        server.tell("title", text=self._name)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._ros.__exit__(*error)

    def run(self) -> None:
        """Follows the node and the viewers for ever."""
        while True:
            self.work()

    def work(self) -> None:
        """Shows what arrives for a moment; waits while there are no viewers."""
        is_watched = self._server.num_viewers > 0
        if is_watched != bool(self._subscriptions):
            (self._subscribe if is_watched else self._unsubscribe)()
        try:
            command = self._server.commands.get(block=not is_watched)
        except Empty:
            self._look_for_node()
            self._ros.spin_for(_ROUND_S)
        else:
            self._follow(command)

    def _follow(self, command: dict[str, Any]) -> None:
        match command:
            case {"do": "set", "name": str(name), "value": value}:
                self._set({name: value})
            case {"do": "explain" | "forget"}:
                self._asked = Asked.by(command)
                self._server.tell("reasons", lines=[])
                self._ask()
            case {"do": "reset"}:
                changeable = (one for one in declared_settings() if not one.fixed)
                values = {one.name: one.default for one in changeable}
                self._set({k: v for k, v in values.items() if self._settings.value_of(k) != v})

    def _look_for_node(self) -> None:
        if self._parameters is not None:
            self._parameters.ask()
        is_there = self._ros.num_publishers(self._topics["/flow"]) > 0
        if self._is_there and not is_there:
            text = f"{self._name} does not run, or has another name: mnsf view --node NAME"
            warnings = [{"level": "error", "text": text}]
            self._server.tell("status", latency=None, values={}, warnings=warnings)
        self._is_there = is_there

    def _set(self, values: dict[str, Any]) -> None:
        try:
            checked = {name: declared_setting(name).checked(v) for name, v in values.items()}
        except SettingsError as error:
            self._refuse(str(error))
            return
        if self._parameters is not None:
            self._parameters.set(checked)

    def _refuse(self, reason: str) -> None:
        self._server.refuse(reason)
        self._publish_knobs()

    def _receive_settings(self, values: dict[str, Any]) -> None:
        try:
            self._settings = self._settings.changed(values)
        except SettingsError as error:
            _LOG.warning("%s: a parameter of another version: %s", self._name, error)
        self._publish_knobs()

    def _publish_knobs(self) -> None:
        self._server.tell("knobs", **knobs(self._settings, of_node=True))

    def _forget(self) -> None:
        self._waiting: dict[int, dict[str, Any]] = {}
        self._paths = Paths()
        self._shown: Scene | None = None
        self._latency_ms: float | None = None
        self._is_there = True

    def _subscribe(self) -> None:
        self._forget()
        self._parameters = RemoteParameters(
            self._ros.node, self._name, self._receive_settings, self._refuse
        )
        for part, msgtype in _PARTS.items():
            self._add(self._topics[part], msgtype, self._receiver(part))
        self._add(f"{self._name}{_LATENCY[0]}", _LATENCY[1], self._receive_latency)
        self._add(f"{self._name}{_ANSWERS}", _STATUSES, self._receive_answer)
        self._add("/diagnostics", _STATUSES, self._receive_diagnostics)

    def _add(self, topic: str, msgtype: str, receive: Callable[[Any], None]) -> None:
        def decode(raw: bytes) -> None:
            try:
                receive(jazzy().deserialize_cdr(raw, msgtype))
            except (MessageError, ValueError) as error:
                _LOG.warning("%s: a message that cannot be shown: %s", topic, one_line(error))

        self._subscriptions.append(self._ros.subscribe(topic, msgtype, decode))

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions:
            self._ros.unsubscribe(subscription)
        self._subscriptions.clear()
        if self._parameters is not None:
            self._parameters.close()
        self._parameters = None

    def _receiver(self, part: str) -> Callable[[Any], None]:
        def receive(message: Any) -> None:  # noqa: ANN401 - of several types
            stamp_ns = decode_stamp(message.header.stamp)
            if self._waiting and stamp_ns < max(self._waiting) - _JUMP_NS:
                self._waiting.clear()
            self._waiting.setdefault(stamp_ns, {})[part] = message
            for shown_ns in self._complete():
                self._show(shown_ns, self._waiting.pop(shown_ns))

        return receive

    def _complete(self) -> list[int]:
        """Drops all before the newest stamp with all parts, or with flow and passed by.

        Returns that stamp, none if there is none.
        """
        stamps = sorted(self._waiting)
        complete = [one for one in stamps if len(self._waiting[one]) == len(_PARTS)]
        passed_by = [one for one in stamps[:-1] if "/flow" in self._waiting[one]]
        chosen = (complete or passed_by)[-1:]
        first_ns = max(chosen, default=stamps[-_MAX_WAITING:][0])
        self._waiting = {one: self._waiting[one] for one in stamps if one >= first_ns}
        return chosen

    def _show(self, stamp_ns: int, parts: dict[str, Any]) -> None:
        scene = _scene(stamp_ns, parts)
        trails = self._paths.after(stamp_ns, scene.world_from_sensor, scene.objects)
        self._server.publish("scene", scene_message(scene, trails))
        self._shown = scene
        self._ask()

    def _ask(self) -> None:
        """Asks the node about the place in the scene that is shown; the answer comes later."""
        if self._asked is None or self._shown is None:
            return
        x, y = self._asked.place_in(self._shown.objects)
        self._questions.publish(_question(self._shown.stamp_ns, x, y))

    def _receive_answer(self, message: Any) -> None:  # noqa: ANN401
        if self._asked is not None:
            (status,) = message.status
            lines = [f"{item.key}: {item.value}" for item in status.values]
            self._server.tell("reasons", lines=lines or [status.message])

    def _receive_latency(self, message: Any) -> None:  # noqa: ANN401
        self._latency_ms = float(message.data)

    def _receive_diagnostics(self, message: Any) -> None:  # noqa: ANN401
        own = [one for one in message.status if one.name.startswith(f"{self._name[1:]}: ")]
        if not own:
            return
        known = {
            item.key: item.value
            for one in own
            for item in one.values
            if one.name.endswith(": flow") or item.key == "source"
        }
        warnings = [
            {"level": _LEVELS[one.level], "text": f"{one.name.rpartition(': ')[2]}: {one.message}"}
            for one in own
            if one.level in _LEVELS
        ]
        values = {text: known[key] for key, text in _VALUES.items() if key in known}
        self._server.tell("status", latency=self._latency_ms, values=values, warnings=warnings)


def _scene(stamp_ns: int, parts: dict[str, Any]) -> Scene:
    """Returns the scene of the messages of one stamp.

    Raises:
        MessageError: One of them cannot be decoded.
        ValueError: One of them lacks a field.
    """
    xyz, finite = decode_xyz(parts["/flow"])
    points = decode_points(parts["/flow"]).ravel()[finite]
    colors = motion_colors(np.zeros_like(xyz), points["dynamic"] != 0)
    if COLOR_NAME in (points.dtype.names or ()):
        packed = np.ascontiguousarray(points[COLOR_NAME]).view(np.uint32)
        colors = packed & np.uint32(0xFFFFFF) | colors & np.uint32(0xFF000000)
    ego, objects = parts.get("/ego_motion"), parts.get("/objects")
    pose = np.eye(4) if ego is None else pose_matrix(ego.pose.pose)
    rows: Any = () if objects is None else decode_points(objects).ravel()
    return Scene(stamp_ns, xyz, colors, pose, [_object(row) for row in rows])


def _question(stamp_ns: int, x: float, y: float) -> bytes:
    """A serialized place of a sweep, in the frame of its cloud."""
    types = jazzy().types
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    point = types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    message = types[_QUESTIONS[1]](header=header, point=point)
    return bytes(jazzy().serialize_cdr(message, _QUESTIONS[1]))


def _object(row: Any) -> TrackedObject:  # noqa: ANN401 - of a structured array
    def vector(*names: str) -> Any:  # noqa: ANN401
        return np.array([row[name] for name in names], np.float64)

    return TrackedObject(
        track_id=int(row["id"]),
        center=vector("x", "y", "z"),
        size=vector("length", "width", "height"),
        yaw=float(row["yaw"]),
        velocity=vector("vx", "vy", "vz"),
        covariance=np.zeros((6, 6)),
        age_s=float(row["age"]),
        num_points=int(row["num_points"]),
    )
