# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who is served by the page server, and with what."""

import http.client
import json
import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from mnsf_ros.view import page_server
from mnsf_ros.view.page_server import PageServer

PATIENCE_S = 60.0


def until(condition: Callable[[], object]) -> None:
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


@pytest.fixture
def server() -> PageServer:
    return PageServer(max_viewers=3)


@pytest.fixture
def address(server: PageServer) -> Iterator[str]:
    with server.listening("127.0.0.1", 0) as address:
        yield address


def joined(address: str, **others: object) -> ClientConnection:
    url = urlsplit(address)
    query = f"?{url.query}" if url.query else ""
    return connect(f"ws://127.0.0.1:{url.port}/socket{query}", max_size=None, **others)


def fetched(address: str, path: str, **headers: str) -> tuple[int, str]:
    """Status and text of a file."""
    url = urlsplit(address)
    query = f"?{url.query}" if url.query and "?" not in path else ""
    connection = http.client.HTTPConnection("127.0.0.1", url.port, timeout=PATIENCE_S)
    with closing(connection):
        connection.request("GET", path + query, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()


def status(address: str, path: str = "/", **headers: str) -> int:
    return fetched(address, path, **headers)[0]


def test_the_page_refers_to_its_own_files_only(address: str) -> None:
    texts = {}
    waiting = ["/"]
    while waiting:
        path = waiting.pop()
        found_status, texts[path] = fetched(address, path)
        assert found_status == 200, path
        found = re.findall(
            r'(?:src|href|from) ?=?"([^"]+)"', texts[path].replace('from "', 'from"')
        )
        names = {f"/{name.removeprefix('./')}" for name in found if not name.startswith("data:")}
        waiting += [name for name in names if name not in texts and name not in waiting]
    assert len(texts) >= 6
    assert "//" not in re.sub(r"//.*$", "", texts["/"], flags=re.MULTILINE)


@pytest.mark.parametrize(
    "path",
    ["/nothing", "/../page_server.py", "/%2e%2e/page_server.py", "//etc/passwd", "//[", "/?x=1/.."],
)
def test_only_files_of_the_page_are_served(address: str, path: str) -> None:
    assert status(address, path) == (200 if path.startswith("/?") else 404)


def test_pages_of_other_sites_are_refused(address: str) -> None:
    netloc = urlsplit(address).netloc
    assert status(address, Host="evil.example") == 403
    assert status(address, Host="evil.example:80", Origin="http://evil.example:80") == 403
    assert status(address, Host="localhost:1234") == 200  # a tunnel
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1", f"https://{netloc}"):
        with pytest.raises(InvalidStatus, match="403"):
            joined(address, origin=origin)
    joined(address, origin=f"http://{netloc}").close()


def test_on_a_network_a_token_is_needed(server: PageServer) -> None:
    with server.listening("0.0.0.0", 0) as address:
        assert re.search(r"\?token=.{20,}$", address)
        assert status(address, Host="robot.local") == 200
        for wrong in ("", "?token=", "?token=x"):
            for path in ("/", "/socket"):
                assert status(f"http://127.0.0.1:{urlsplit(address).port}", path + wrong) == 403
        joined(address).close()


def test_more_viewers_than_allowed_are_told(server: PageServer, address: str) -> None:
    several = [joined(address) for _ in range(3)]
    until(lambda: server.num_viewers == 3)
    with joined(address) as late, pytest.raises(ConnectionClosed, match="3 viewers"):
        late.recv(timeout=PATIENCE_S)
    for one in several:
        one.close()
    until(lambda: server.num_viewers == 0)
    joined(address).close()


def test_late_viewers_get_the_newest_of_each_kind(server: PageServer, address: str) -> None:
    for number in range(5):
        server.publish("scene", bytes([number]))
        server.publish("status", str(number))
    with joined(address) as viewer:
        assert {viewer.recv(timeout=PATIENCE_S) for _ in range(2)} == {b"\x04", "4"}
        server.publish("scene", b"new")
        assert viewer.recv(timeout=PATIENCE_S) == b"new"
        server.refuse("no")
        assert json.loads(viewer.recv(timeout=PATIENCE_S)) == {"kind": "refused", "text": "no"}
    with joined(address) as viewer:
        assert {viewer.recv(timeout=PATIENCE_S) for _ in range(2)} == {b"new", "4"}
        server.publish("scene", b"end")
        assert viewer.recv(timeout=PATIENCE_S) == b"end"


def test_viewers_that_do_not_read_skip_messages_and_are_dropped(
    server: PageServer, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = urlsplit(address)
    monkeypatch.setattr(page_server, "_SLOWEST_S", 0.5)
    deaf = socket.create_connection(("127.0.0.1", url.port))
    deaf.sendall(
        f"GET /socket HTTP/1.1\r\nHost: {url.netloc}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    with joined(address) as viewer, deaf:
        until(lambda: server.num_viewers == 2)
        for number in range(30):
            server.publish("scene", bytes([number]) * 2_000_000)
            while viewer.recv(timeout=PATIENCE_S)[0] != number:
                pass
        until(lambda: server.num_viewers == 1)


def test_a_slow_viewer_is_not_far_behind(server: PageServer, address: str) -> None:
    with joined(address, max_queue=1) as viewer:
        for number in range(200):
            server.publish("player", "another")
            server.publish("scene", bytes([number]) * 200_000)
            time.sleep(0.002)
        server.publish("player", "last")
        received = [viewer.recv(timeout=PATIENCE_S)]
        while received[-1] != "last":
            received.append(viewer.recv(timeout=PATIENCE_S))
    # In the order of publishing.
    assert received[-2][0] == 199
    assert len(received) < 20


@pytest.mark.parametrize(
    "raw", ["", "no json", "[1]", '{"do": 1}', "[" * 2000, b"\xff", "x" * 5000]
)
def test_who_sends_no_command_is_dropped(server: PageServer, address: str, raw: str) -> None:
    with joined(address) as viewer:
        assert server.commands.get(timeout=PATIENCE_S) == {"do": "joined"}
        viewer.send(json.dumps({"do": "play"}))
        assert server.commands.get(timeout=PATIENCE_S) == {"do": "play"}
        viewer.send(raw)
        with pytest.raises(ConnectionClosed):
            viewer.recv(timeout=PATIENCE_S)
    assert server.commands.empty()


def test_a_flood_of_commands_is_bounded(server: PageServer, address: str) -> None:
    with joined(address) as viewer:
        for _ in range(1000):
            viewer.send('{"do": "play"}')
        viewer.send("end")
        with pytest.raises(ConnectionClosed):
            viewer.recv(timeout=PATIENCE_S)
    assert server.commands.qsize() <= 100


def test_an_address_of_ipv6_has_brackets(server: PageServer) -> None:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        pytest.skip("needs IPv6")
    with server.listening("::1", 0) as address:
        assert re.fullmatch(r"http://\[::1\]:\d+/", address)
