# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who may load the page and connect to it."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from contextlib import suppress
from typing import Final
from urllib.parse import parse_qs, urlsplit

from websockets.http11 import Request

SOCKET: Final = "/socket"
_LOOPBACK_NAMES: Final = ("localhost", "127.0.0.1", "::1")
_EVERY_INTERFACE: Final = ("0.0.0.0", "::")


class Access:
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
            return self._refusal_by_token(request.path)
        is_own = _name(hosts[0]) in (*_LOOPBACK_NAMES, self._host)
        return "" if is_own else f"foreign Host {hosts[0]!r}"

    def _refusal_by_token(self, path: str) -> str:
        file, _, query = path.partition("?")
        given = parse_qs(query).get("token", [""])[0]
        is_right = secrets.compare_digest(given.encode(), self._token.encode())
        if is_right or file not in ("/", SOCKET):
            return ""
        return "the token is missing or wrong: open the address that mnsf view prints"


def _name(host: str) -> str | None:
    with suppress(ValueError):
        return urlsplit(f"//{host}").hostname
    return None


def _is_loopback(host: str) -> bool:
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"
