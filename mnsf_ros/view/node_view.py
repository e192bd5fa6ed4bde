# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A running node on the page: its flow, its status, its parameters."""

import logging
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.errors import SettingsError, one_line
from mnsf_ros.geometry.transforms import pose_matrix
from mnsf_ros.node.parameters import RemoteParameters
from mnsf_ros.node.raw_topics import RawTopics, message_class
from mnsf_ros.settings import Settings, declared_setting
from mnsf_ros.sweeps.sweep import NANOSECONDS
from mnsf_ros.sweeps_io.flow_columns import COLOR_NAME
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.page_view import PageView
from mnsf_ros.view.scene_message import DrawnSweep, Paths, motion_colors, scene_message
from msg_utils.errors import MessageError
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import decode_points, decode_xyz
from msg_utils.stamps import decode_stamp

_LOG = logging.getLogger(__name__)
# Below the name of the node; together they are a scene.
_PARTS: Final = {
    "/flow": CLOUD_TYPE,
    "/objects": CLOUD_TYPE,
    "/ego_motion": "nav_msgs/msg/Odometry",
}
_LATENCY: Final = ("/debug/pipeline_latency_ms", "std_msgs/msg/Float64")
_QUESTIONS: Final = ("/explain", "geometry_msgs/msg/PointStamped")
_ANSWERS: Final = "/explanation"
_STATUSES: Final = "diagnostic_msgs/msg/DiagnosticArray"
_ERROR: Final = b"\x02"
_LEVELS: Final = {b"\x01": "warning", _ERROR: "error", b"\x03": "stale"}
# Key of a diagnostic status to its name on the page.
_VALUES: Final = {
    "latency median [ms]": "latency, median (ms)",
    "latency p95 [ms]": "latency, 95th percentile (ms)",
    "rate [Hz]": "flows a second",
    "flows_out": "flows out",
    "triplets_dropped": "dropped",
    "own body": "own body",
    "source": "ego motion",
}
_LOST: Final = "lost"
_ROUND_S: Final = 0.05
_PARAMETERS_PERIOD_S: Final = 1.0
_MAX_WAITING: Final = 5
_JUMP_NS: Final = NANOSECONDS  # back in time: a recording that starts again

Self = TypeVar("Self", bound="NodeView")


class NodeView(PageView):
    """Subscribes to a node while there are viewers; use it as a context manager."""

    def __init__(self, server: PageServer, node: str, flow: str | None = None) -> None:
        """Joins the ROS graph.

        Args:
            server: Has the viewers.
            node: Full name such as `/scene_flow`.
            flow: Topic of the flow, if it is not `flow` below that name.
        """
        self._name = f"/{node.strip('/')}"
        super().__init__(server, self._name, Settings(), of_node=True)
        self._topics = {part: f"{self._name}{part}" for part in _PARTS}
        if flow is not None:
            self._topics["/flow"] = f"/{flow.strip('/')}"
        self._ros = RawTopics("mnsf_view")
        self._parameters = RemoteParameters(
            self._ros.node, self._name, self._receive_settings, self._refuse
        )
        self._subscriptions: list[Any] = []
        self._questions = self._ros.publisher(f"{self._name}{_QUESTIONS[0]}", _QUESTIONS[1])
        self._forget()

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._ros.__exit__(*error)

    def _forget(self) -> None:
        self._waiting: dict[int, dict[str, Any]] = {}  # parts by their stamp
        self._paths = Paths()
        self._shown: DrawnSweep | None = None
        self._latency_ms: float | None = None
        self._is_there = True
        self._parameters_due_s = 0.0

    def work(self) -> None:
        """Shows what arrives for a moment; waits while there are no viewers."""
        is_watched = self._server.num_viewers > 0
        if is_watched != bool(self._subscriptions):
            (self._subscribe if is_watched else self._unsubscribe)()
        super().work()

    def _idle_s(self) -> float | None:
        return 0.0 if self._subscriptions else None

    def _advance(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._parameters_due_s:
            self._parameters_due_s = now_s + _PARAMETERS_PERIOD_S
            self._parameters.ask()
        is_there = self._ros.node.count_publishers(self._topics["/flow"]) > 0
        if self._is_there and not is_there:
            text = f"{self._name} does not run (yet), or has another name: mnsf view --node NAME"
            warnings = [{"level": "error", "text": text}]
            self._server.tell("status", latency=None, values={}, warnings=warnings, lost="")
            self._wait(f"waiting for the node: {text}")
        self._is_there = is_there
        self._ros.spin_for(_ROUND_S)

    def _set(self, values: Mapping[str, Any]) -> None:
        self._parameters.set(
            {name: declared_setting(name).checked(v) for name, v in values.items()}
        )

    def _receive_settings(self, values: dict[str, Any]) -> None:
        try:
            self._settings = self._settings.changed(values)
        except SettingsError as error:
            _LOG.warning("%s: a parameter of another version: %s", self._name, error)
        self._publish_knobs()

    def _subscribe(self) -> None:
        self._forget()
        for part, msgtype in _PARTS.items():
            self._add(self._topics[part], msgtype, partial(self._receive_part, part))
        self._add(f"{self._name}{_LATENCY[0]}", _LATENCY[1], self._receive_latency)
        self._add(f"{self._name}{_ANSWERS}", _STATUSES, self._receive_answer)
        self._add("/diagnostics", _STATUSES, self._receive_diagnostics)

    def _add(self, topic: str, msgtype: str, receive: Callable[[Any], None]) -> None:
        def try_to_receive(message: Any) -> None:  # noqa: ANN401 - of several types
            try:
                receive(message)
            except (MessageError, SettingsError, ValueError) as error:
                _LOG.warning("%s: a message that cannot be shown: %s", topic, one_line(error))

        self._subscriptions.append(self._ros.subscribe(topic, msgtype, try_to_receive))

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions:
            self._ros.node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _receive_part(self, part: str, message: Any) -> None:  # noqa: ANN401
        """Shows the scene that a message completes, or the last one with flow that it passes by."""
        stamp_ns, waiting = decode_stamp(message.header.stamp), self._waiting
        if waiting and stamp_ns < max(waiting) - _JUMP_NS:
            waiting.clear()
        waiting.setdefault(stamp_ns, {})[part] = message
        stamps = sorted(waiting)
        complete = [one for one in stamps if len(waiting[one]) == len(_PARTS)]
        passed_by = [one for one in stamps[:-1] if "/flow" in waiting[one]]
        shown_ns = max(complete or passed_by, default=-1)
        later = (one for one in stamps[-_MAX_WAITING:] if one > shown_ns)
        self._waiting = {one: waiting[one] for one in later}
        if shown_ns in waiting:
            self._show(shown_ns, waiting[shown_ns])

    def _show(self, stamp_ns: int, parts: dict[str, Any]) -> None:
        self._shown = scene = _scene(stamp_ns, parts)
        trails = self._paths.after(stamp_ns, scene.world_from_sensor, scene.objects)
        self._server.publish("scene", scene_message(scene, trails))
        self._ask()

    def _explain(self) -> None:
        self._tell_reasons([])
        self._ask()

    def _ask(self) -> None:
        """Asks the node about the place in the scene that is shown; the answer comes later."""
        if self._asked is None or self._shown is None:
            return
        self._asked = self._asked.followed(self._shown.objects)
        question = message_class(_QUESTIONS[1])()
        stamp, place = question.header.stamp, question.point
        stamp.sec, stamp.nanosec = divmod(self._shown.stamp_ns, NANOSECONDS)
        place.x, place.y = map(float, self._asked.at)
        self._questions.publish(question)

    def _receive_answer(self, message: Any) -> None:  # noqa: ANN401
        if self._asked is not None:
            (status,) = message.status
            lines = [f"{item.key}: {item.value}" for item in status.values]
            self._tell_reasons(lines or [status.message])

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
        worst = max(own, key=lambda one: (one.level, one.name.endswith(": flow")))
        self._wait(f"waiting for {self._topics['/flow']}: {worst.message}")
        self._take_own_body(known.get("own body boxes", ""))
        values = {text: known[key] for key, text in _VALUES.items() if key in known}
        lost = [item.value for one in own for item in one.values if item.key == _LOST]
        is_lost = any(one.name.endswith(": ego motion") and one.level == _ERROR for one in own)
        self._server.tell(
            "status",
            latency=self._latency_ms,
            values=values,
            warnings=warnings,
            lost=lost[0] if lost and is_lost else "",
        )


def _scene(stamp_ns: int, parts: dict[str, Any]) -> DrawnSweep:
    """The scene of the messages of one stamp; MessageError or ValueError for unusable ones."""
    xyz, measured = decode_xyz(parts["/flow"])
    points = decode_points(parts["/flow"]).ravel()[measured]
    colors = motion_colors(np.zeros_like(xyz), points["dynamic"] != 0)
    if COLOR_NAME in (points.dtype.names or ()):
        packed = np.ascontiguousarray(points[COLOR_NAME]).view(np.uint32)
        colors = packed & np.uint32(0xFFFFFF) | colors & np.uint32(0xFF000000)
    ego, objects = parts.get("/ego_motion"), parts.get("/objects")
    pose = np.eye(4) if ego is None else pose_matrix(ego.pose.pose)
    rows: Any = () if objects is None else decode_points(objects).ravel()
    return DrawnSweep(stamp_ns, xyz, colors, pose, [_object(row) for row in rows])


def _object(row: Any) -> TrackedObject:  # noqa: ANN401 - of a structured array
    def vector(*names: str) -> Any:  # noqa: ANN401
        return np.array([row[name] for name in names], np.float64)

    return TrackedObject(
        track_id=int(row["id"]),
        center=vector("x", "y", "z"),
        size=vector("length", "width", "height"),
        yaw=float(row["yaw"]),
        velocity=vector("vx", "vy", "vz"),
        turn_rate=float(row["turn_rate"]),
        covariance=np.zeros((6, 6)),
        age_s=float(row["age"]),
        num_points=int(row["num_points"]),
    )
