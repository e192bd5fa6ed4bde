# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Classes of messages that can be written where no ROS is installed."""

from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from mnsf_ros.recording.bag_topics import jazzy


class Messages:
    """The messages of a package, for example `Messages("nav_msgs").Odometry`.

    They are used as in rclpy. Fields that are not given are 0 or empty, quaternions, too. Types are
    from a store, by default of ROS 2 Jazzy.
    """

    def __init__(self, package: str, store: Typestore | None = None) -> None:
        self._package = package
        self._store = jazzy() if store is None else store

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - a class that mypy does not know
        if (msgtype := f"{self._package}/msg/{name}") not in self._store.fielddefs:
            raise AttributeError(f"{self._package} has no message {name}")
        return _with_defaults(self._store, msgtype)


@cache
def _with_defaults(store: Typestore, msgtype: str) -> type:
    made, (_, fields) = store.types[msgtype], store.fielddefs[msgtype]

    def begin(self: object, **given: object) -> None:
        for name, kind in fields:
            setattr(self, name, given.pop(name) if name in given else _default(store, kind))
        if given:
            raise TypeError(f"{msgtype} has no field {', '.join(given)}")

    return type(made.__name__, (made,), {"__init__": begin})


def _default(store: Typestore, kind: Any) -> Any:  # noqa: ANN401 - any field
    node, detail = kind
    if node == Nodetype.NAME:
        return _with_defaults(store, detail)()
    if node == Nodetype.BASE:
        return "" if detail[0] == "string" else np.zeros((), _dtype(detail[0])).item()
    item, length = detail
    length = length if node == Nodetype.ARRAY else 0
    if item[0] == Nodetype.BASE and item[1][0] != "string":
        return np.zeros(length, _dtype(item[1][0]))
    return [_default(store, item) for _ in range(length)]


def _dtype(name: str) -> str:
    return "uint8" if name in ("octet", "byte", "char") else name
