# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Server for Foxglove and Lichtblick: topics with messages of ROS 2, without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

from mnsf_ros.errors import MnsfError
from mnsf_ros.recording.bag_messages import message_definition

# Messages that wait for a slow viewer; then the oldest are dropped. Clouds have megabytes.
_BACKLOG: Final = 16


class ViewError(MnsfError):
    """Nothing can be shown."""


class Addresses(NamedTuple):
    """Where viewers find a server, and a page that shows it in a browser."""

    url: str
    page: str


class ViewServer:
    """A WebSocket server for some topics.

    Its channels are made before it listens: a viewer that subscribes while they are being made may
    be told that there is no such channel, and never see anything on it.
    """

    def __init__(self) -> None:
        """Does not listen yet.

        Raises:
            ViewError: There is no foxglove-sdk.
        """
        try:
            import foxglove
        except ImportError:
            raise ViewError(
                "no foxglove-sdk in this Python, by which it is shown; in the checkout: "
                "pip install '.[view]'"
            ) from None
        self._foxglove: Any = foxglove
        self._context = foxglove.Context()

    @contextmanager
    def listening(self, host: str, port: int) -> Iterator[Addresses]:
        """Lets viewers connect; a port of 0 is any free one.

        Raises:
            ViewError: The port cannot be used.
        """
        try:
            server = self._foxglove.start_server(
                name="mnsf_ros",
                host=host,
                port=port,
                context=self._context,
                message_backlog_size=_BACKLOG,
            )
        except (OSError, RuntimeError, OverflowError) as error:
            raise ViewError(
                f"cannot serve on {host}:{port}: {error}; choose another --port"
            ) from None
        shown_host = f"[{host}]" if ":" in host else host
        try:
            yield Addresses(f"ws://{shown_host}:{server.port}", str(server.app_url()))
        finally:
            server.stop()

    def channel(self, topic: str, msgtype: str) -> Any:  # noqa: ANN401 - of a library without types
        """Returns the channel of a topic for serialized messages of a type of ROS 2 Jazzy."""
        schema = self._foxglove.Schema(
            name=msgtype, encoding="ros2msg", data=message_definition(msgtype).encode()
        )
        return self._foxglove.Channel(
            topic, schema=schema, message_encoding="cdr", context=self._context
        )

    def typed_channel(self, topic: str, kind: str) -> Any:  # noqa: ANN401
        """Returns the channel of a topic for messages of Foxglove's own, such as `SceneUpdate`."""
        from foxglove import channels

        return getattr(channels, f"{kind}Channel")(topic, context=self._context)
