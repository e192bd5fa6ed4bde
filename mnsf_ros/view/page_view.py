# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the views of a recording and of a node share: commands of viewers, and parameters."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from queue import Empty
from typing import Any, Final

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.errors import SettingsError
from mnsf_ros.setting import Setting
from mnsf_ros.settings import Settings, declared_settings
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.view.page_server import PageServer

_USUAL: Final = 2**31
# Groups that only networks read, and those that only a node reads.
_NETWORKS: Final = frozenset(
    ("distance", "nsfp", "mnsf_cycle", "linear", "field", "optimization", "early_stopping")
) | {"fusion", "compute"}
_NODE: Final = frozenset(
    ("tf", "lidars", "lidar_1", "lidar_2", "lidar_3", "lidar_4", "output", "node")
)
_TITLE: Final = (
    "From the page of mnsf view: what was changed, and the robot's own body as it was found. The "
    "other parameters have their defaults."
)
_OWN_BODY: Final = "crop.own_body"


def are_usual(*values: object) -> bool:
    """Whether values are numbers, neither NaN nor too large for whatever is done with them."""
    return all(isinstance(value, (int, float)) and abs(value) < _USUAL for value in values)


@dataclass(frozen=True)
class Asked:
    """What a viewer wants explained.

    Attributes:
        at: Place (x, y), metres, sensor frame.
        track: `track_id` of an object to be followed from sweep to sweep; 0 for none.
    """

    at: tuple[float, float]
    track: int

    @classmethod
    def by(cls, command: Mapping[str, Any]) -> "Asked | None":
        """Returns what a command asks for; None for nothing, or nothing usual."""
        match command:
            case {"at": [x, y], "track": int(track)} if are_usual(x, y, track):
                return cls((x, y), track)
        return None

    def followed(self, objects: Sequence[TrackedObject]) -> "Asked":
        """Returns the same where the object is in a sweep; without it, where it was last."""
        for item in objects:
            if item.track_id == self.track:
                return replace(self, at=(float(item.center[0]), float(item.center[1])))
        return self


class PageView(ABC):
    """Shows sweeps to the viewers of a server, and follows their commands."""

    def __init__(
        self, server: PageServer, title: str, settings: Settings, *, of_node: bool = False
    ) -> None:
        """`settings` are those at first, to which viewers can return."""
        self._server = server
        self._settings, self._first_settings = settings, settings
        self._hidden = frozenset() if of_node else _NODE
        self._asked: Asked | None = None
        self._found_body = ""
        server.tell("title", text=title)

    def run(self) -> None:
        """Follows the viewers for ever."""
        while True:
            self.work()

    def work(self) -> None:
        """Follows the next command, or goes on if none comes in time."""
        try:
            command = self._server.commands.get(timeout=self._idle_s())
        except Empty:
            self._advance()
        else:
            self._follow(command)

    @abstractmethod
    def _idle_s(self) -> float | None:
        """Seconds without work; None until the next command."""

    @abstractmethod
    def _advance(self) -> None:
        """Does a little of what is to be done without a command."""

    @abstractmethod
    def _set(self, values: Mapping[str, Any]) -> None:
        """Changes settings by their names; raises SettingsError if they do not fit."""

    @abstractmethod
    def _explain(self) -> None:
        """Tells the reasons for what is asked about in the sweep that is shown."""

    def _follow(self, command: dict[str, Any]) -> None:
        match command:
            case {"do": "set", "name": str(name), "value": value}:
                self._try_to_set({name: value})
            case {"do": "reset"}:
                first = self._first_settings.to_mapping()
                self._try_to_set({one: first[one] for one in self._changed(first)})
            case {"do": "explain" | "forget"}:
                self._asked = Asked.by(command)
                self._explain()

    def _tell_reasons(self, lines: list[str]) -> None:
        """Tells the reasons for what is asked about; the page may be at another track by now."""
        track = 0 if self._asked is None else self._asked.track
        self._server.tell("reasons", lines=lines, track=track)

    def _try_to_set(self, values: Mapping[str, Any]) -> None:
        try:
            self._set(values)
        except SettingsError as error:
            self._refuse(str(error))

    def _wait(self, text: str) -> None:
        """Says what a page without any sweep waits for."""
        self._server.tell("waiting", text=text)

    def _refuse(self, reason: str) -> None:
        self._server.refuse(reason)
        self._publish_knobs()

    def _take_own_body(self, boxes: str) -> None:
        """Shows the own body that was found, and offers to save it.

        Args:
            boxes: As in `crop.own_body`; empty for none.

        Raises:
            SettingsError: These are no boxes.
        """
        if boxes != self._found_body:
            Settings().changed({_OWN_BODY: boxes or "none"})
            self._found_body = boxes
            self._publish_knobs()

    def _changed(self, usual: Mapping[str, Any]) -> list[str]:
        """Names of the settings that differ and can be changed."""
        return [
            one.name
            for one in declared_settings()
            if not one.fixed and self._settings.value_of(one.name) != usual[one.name]
        ]

    def _publish_knobs(self) -> None:
        """Tells the settings of groups that have an effect, and a file of what is to be kept.

        That are those that are changed, and the own body that was found.
        """
        usual, now = Settings().to_mapping(), self._settings
        is_found = self._found_body and now.crop.own_body == "auto"
        kept = now.changed({_OWN_BODY: self._found_body}) if is_found else now
        changed, saved = (
            [name for name, value in usual.items() if each.value_of(name) != value]
            for each in (now, kept)
        )
        is_online = now.method.name == usual["method.name"]
        hidden = self._hidden | (_NETWORKS if is_online else {"objects"})
        groups = []
        for group in fields(Settings):
            offered = [
                _knob(one, now)
                for one in declared_settings()
                if one.group == group.name and not one.fixed
            ]
            if offered and group.name not in hidden:
                text = (type(group.default).__doc__ or "").partition("\n")[0]
                groups.append({"name": group.name, "text": text, "knobs": offered})
        self._server.tell(
            "knobs",
            groups=groups,
            file=settings_yaml(kept, _TITLE, saved),
            changed=changed,
            saved=saved,
            body=kept.crop.own_boxes,
        )


def _knob(setting: Setting, settings: Settings) -> dict[str, Any]:
    return vars(setting) | {
        "kind": setting.kind.__name__,
        "value": settings.value_of(setting.name),
        "unit": setting.unit,
    }
