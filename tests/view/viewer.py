# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A viewer as Foxglove is one: the protocol foxglove.sdk.v1 over a WebSocket."""

from __future__ import annotations

import json
import struct
import time
from collections import defaultdict

from websockets.sync.client import ClientConnection, connect

_MESSAGE = 1
_HEAD = struct.Struct("<BIQ")


class Viewer:
    """Subscribes to everything that is advertised; a context manager."""

    def __init__(self, url: str) -> None:
        self._socket: ClientConnection = connect(
            url, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=300
        )
        self.channels: dict[int, dict[str, str]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = defaultdict(list)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def until(self, condition, patience_s: float = 300.0) -> None:
        """Receives until a condition on the viewer holds."""
        give_up_s = time.monotonic() + patience_s
        while not condition(self):
            assert time.monotonic() < give_up_s
            try:
                self._receive(self._socket.recv(timeout=1.0))
            except TimeoutError:
                continue

    def _receive(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._advertised(json.loads(message))
            return
        operation, channel, time_ns = _HEAD.unpack_from(message)
        if operation == _MESSAGE:
            topic = self.channels[channel]["topic"]
            self.messages[topic].append((time_ns, message[_HEAD.size :]))

    def _advertised(self, said: dict) -> None:
        if said["op"] != "advertise":
            return
        numbers = [channel["id"] for channel in said["channels"]]
        self.channels |= {channel["id"]: channel for channel in said["channels"]}
        subscriptions = [{"id": number, "channelId": number} for number in numbers]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
