# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Server of the page: its files, and a WebSocket for each viewer with the newest messages."""

import asyncio
import ipaddress
import json
import logging
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from importlib.resources import files
from queue import Full, Queue
from threading import Thread
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from mnsf_ros.errors import MnsfError

Message = str | bytes

MAX_VIEWERS: Final = 16
# A viewer that takes longer for what waits is dropped.
_SLOWEST_S: Final = 20.0
_MAX_COMMAND_BYTES: Final = 4096
_MAX_COMMANDS: Final = 100
_TRY_AGAIN_LATER: Final = 1013
_UNSUPPORTED: Final = 1003
_SOCKET: Final = "/socket"
_LOOPBACK_NAMES: Final = ("localhost", "127.0.0.1", "::1")
_EVERY_INTERFACE: Final = ("0.0.0.0", "::")
_TYPES: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
}
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'self'; connect-src 'self' ws:; img-src 'self' data:; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer:
    """Serves the page to browsers, in a thread of its own.

    Each kind of message has one place: a viewer gets the newest of each kind, and skips those that
    it was too slow for.

    Attributes:
        commands: Commands of viewers, JSON objects with the text `do`; `joined` when one connects.
    """

    def __init__(self, max_viewers: int = MAX_VIEWERS) -> None:
        self.commands: Queue[dict[str, Any]] = Queue(_MAX_COMMANDS)
        self._max_viewers = max_viewers
        self._files = _page_files()
        self._loop: asyncio.AbstractEventLoop | None = None
        # While it listens, all below belongs to the thread of the loop.
        self._viewers: set[_Viewer] = set()
        self._newest: dict[str, Message] = {}
        self._access = _Access("localhost")

    @property
    def num_viewers(self) -> int:
        """Number of connected viewers."""
        return len(self._viewers)

    def publish(self, kind: str, message: Message) -> None:
        """Sends a message to all viewers, later ones too, until another one of its kind comes."""
        if self._loop is None:
            self._newest[kind] = message
        else:
            self._loop.call_soon_threadsafe(self._publish, kind, message)

    def tell(self, kind: str, **values: object) -> None:
        """Publishes a message in JSON."""
        self.publish(kind, json.dumps({"kind": kind, **values}))

    def refuse(self, reason: str) -> None:
        """Tells the viewers of now, but no later ones, why a command is not followed."""
        if self._loop is not None:
            message = json.dumps({"kind": "refused", "text": reason})
            self._loop.call_soon_threadsafe(self._send, "refused", message)

    @contextmanager
    def listening(self, host: str, port: int) -> Iterator[str]:
        """Lets viewers connect; gives the address of the page. A port of 0 is any free one.

        On an address of the network the address has a token, without which nobody is served.

        Raises:
            MnsfError: The address cannot be used.
        """
        self._access = _Access(host)
        with _running_loop() as loop:
            try:
                server = asyncio.run_coroutine_threadsafe(self._serve(host, port), loop).result()
            except (OSError, OverflowError) as error:
                raise MnsfError(
                    f"cannot serve on {host}:{port}: {error}; choose another --host or --port"
                ) from None
            self._loop = loop
            try:
                yield self._access.address(next(iter(server.sockets)).getsockname()[1])
            finally:
                self._loop = None
                asyncio.run_coroutine_threadsafe(self._close(server), loop).result()

    async def _serve(self, host: str, port: int) -> Server:
        # The library logs each scan of the port.
        log = logging.getLogger("mnsf_ros.view.sockets")
        log.setLevel(logging.CRITICAL)
        return await serve(
            self._attend,
            host,
            port,
            process_request=self._answer,
            compression=None,
            max_size=_MAX_COMMAND_BYTES,
            logger=log,
        )

    async def _close(self, server: Server) -> None:
        for viewer in self._viewers:
            viewer.drop()
        server.close()
        await server.wait_closed()

    def _publish(self, kind: str, message: Message) -> None:
        self._newest[kind] = message
        self._send(kind, message)

    def _send(self, kind: str, message: Message) -> None:
        for viewer in self._viewers:
            viewer.put(kind, message)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Returns a file of the page or a refusal; None lets a viewer in."""
        path = request.path.partition("?")[0]
        if refusal := self._access.refusal(request):
            return connection.respond(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        if path == _SOCKET:
            return None
        if path not in self._files:
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file\n")
        kind, content = self._files[path]
        length = str(len(content))
        headers = Headers(_HEADERS | {"Content-Type": kind, "Content-Length": length})
        return Response(HTTPStatus.OK, "OK", headers, content)

    async def _attend(self, connection: ServerConnection) -> None:
        """Serves one viewer until it leaves or is dropped."""
        if len(self._viewers) >= self._max_viewers:
            text = f"{self._max_viewers} viewers are connected already"
            await connection.close(_TRY_AGAIN_LATER, text)
            return
        viewer = _Viewer(connection, self._newest)
        self._viewers.add(viewer)
        self._take({"do": "joined"})
        sending = asyncio.create_task(viewer.send_news())
        try:
            async for raw in connection:
                command = _command(raw)
                if command is None:
                    await connection.close(_UNSUPPORTED, "no command")
                    break
                self._take(command)
        finally:
            self._viewers.discard(viewer)
            sending.cancel()

    def _take(self, command: dict[str, Any]) -> None:
        # More commands than are worked off: the newest are dropped.
        with suppress(Full):
            self.commands.put_nowait(command)


class _Viewer:
    """A connection, and the newest message of each kind that it has not got yet."""

    def __init__(self, connection: ServerConnection, newest: dict[str, Message]) -> None:
        self._connection = connection
        self._waiting = dict(newest)
        self._has_news = asyncio.Event()
        self._has_news.set()

    def put(self, kind: str, message: Message) -> None:
        # Those of different kinds arrive in the order in which they were published.
        self._waiting.pop(kind, None)
        self._waiting[kind] = message
        self._has_news.set()

    def drop(self) -> None:
        self._connection.transport.abort()

    async def send_news(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                await self._has_news.wait()
                self._has_news.clear()
                try:
                    await asyncio.wait_for(self._send_waiting(), _SLOWEST_S)
                except asyncio.TimeoutError:
                    self.drop()
                    return

    async def _send_waiting(self) -> None:
        """Returns when all has arrived: buffers on the way hold many scenes, soon old ones."""
        waiting, self._waiting = self._waiting, {}
        for message in waiting.values():
            await self._connection.send(message)
        await (await self._connection.ping())


class _Access:
    """The rule of one server: on this computer its own pages, on a network who has the token."""

    def __init__(self, host: str) -> None:
        self._host = host
        self._token = "" if _is_loopback(host) else secrets.token_urlsafe(16)

    def address(self, port: int) -> str:
        """Returns the address of the page, with the token."""
        host = socket.gethostname() if self._host in _EVERY_INTERFACE else self._host
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{port}/{f'?token={self._token}' if self._token else ''}"

    def refusal(self, request: Request) -> str:
        """Returns why a request is refused; empty if it is not.

        Pages of other sites reach a server through the browser of a user: by its address, which
        the header Origin tells, or by a name of theirs that leads here, which is in Host.
        """
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1:
            return "one Host is expected"
        if origins and origins != [f"http://{hosts[0]}"]:
            return f"foreign Origin {origins[0]!r}"
        if self._token:
            file, _, query = request.path.partition("?")
            given = parse_qs(query).get("token", [""])[0]
            is_right = secrets.compare_digest(given.encode(), self._token.encode())
            if is_right or file not in ("/", _SOCKET):
                return ""
            return "the token is missing or wrong: open the address that mnsf view prints"
        name = ""
        with suppress(ValueError):
            name = urlsplit(f"//{hosts[0]}").hostname or ""
        return "" if name in (*_LOOPBACK_NAMES, self._host) else f"foreign Host {hosts[0]!r}"


def _is_loopback(host: str) -> bool:
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


@contextmanager
def _running_loop() -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop in a thread of its own."""
    loop = asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever, name="page", daemon=True)
    thread.start()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def _page_files() -> dict[str, tuple[str, bytes]]:
    """Path in the address to type and content."""
    found = {}
    for file in files("mnsf_ros.view").joinpath("page").iterdir():
        kind = _TYPES.get(file.name.rpartition(".")[2])
        if kind is not None:
            found[f"/{file.name}"] = (kind, file.read_bytes())
    found["/"] = found["/index.html"]
    return found


def _command(raw: Message) -> dict[str, Any] | None:
    """Returns the command in a message, None if there is none."""
    with suppress(ValueError, RecursionError):
        command = json.loads(raw)
        if isinstance(command, dict) and isinstance(command.get("do"), str):
            return command
    return None
