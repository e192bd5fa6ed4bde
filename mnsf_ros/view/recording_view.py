# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording is played, estimated and shown, under the control of the page."""

import logging
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final

from mnsf_ros.core.reason_terms import rows_at
from mnsf_ros.errors import EvaluationError, MnsfError
from mnsf_ros.evaluation.recordings import short_name
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import UsedTopics
from mnsf_ros.report.explanation import decision
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.kept_points import boxes_around
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S
from mnsf_ros.view.estimated_sweeps import (
    LAYERS,
    EstimatedSweep,
    estimated_sweeps,
    pose_and_objects,
    scene_of,
)
from mnsf_ros.view.page_server import PageServer
from mnsf_ros.view.page_view import PageView, are_usual
from mnsf_ros.view.scene_message import Paths, Trails, scene_message

_LOG = logging.getLogger(__name__)

# Memory of the method `online`: earlier sweeps have no effect.
_PAST_S: Final = 3.0
# Sweeps that can be stepped back to at once.
_KEPT: Final = 10
_MAX_WARNINGS: Final = 20
_SAME_S: Final = 0.001
_SLOWEST: Final = 0.01
_FASTEST: Final = 100.0


@dataclass(frozen=True, eq=False)
class _Shown:
    """A sweep that was shown."""

    position_s: float
    sweep: EstimatedSweep
    trails: Trails


class RecordingView(PageView):
    """Plays a recording for the viewers of a server; rests while there are none.

    Positions are seconds since the first sweep.
    """

    def __init__(
        self,
        server: PageServer,
        reader: BagReader,
        topics: UsedTopics,
        settings: Settings,
        speed: float = 1.0,
    ) -> None:
        """Starts to play at the beginning.

        Raises:
            SettingsError: The method cannot be made with the settings.
            RecordingError: Damage is met in the recording.
        """
        super().__init__(server, short_name(reader.path), settings)
        self._reader, self._topics = reader, topics
        self._speed, self._is_playing = speed, True
        self._layers = LAYERS if topics.truth is not None else ("estimate",)
        self._layer = "estimate"
        first_ns, last_ns = reader.span_ns
        self._first_ns, self._duration_s = first_ns, (last_ns - first_ns) / NANOSECONDS
        self._first_stamp_ns: int | None = None
        self._warnings: deque[str] = deque(maxlen=_MAX_WARNINGS)
        self._kept: deque[_Shown] = deque(maxlen=_KEPT)
        self._place = -1  # of the shown sweep among the kept ones
        self._due_s = 0.0
        self._interval_s = USUAL_INTERVAL_S
        self._target_s: float | None = None
        self._preview: _Shown | None = None
        self._start_at(0.0)
        self._publish_knobs()
        self._wait("estimating the first sweep")

    def _idle_s(self) -> float | None:
        if self._server.num_viewers == 0:
            return None
        if self._target_s is not None:
            return 1e-6
        return max(1e-6, self._due_s - time.monotonic()) if self._is_playing else None

    def _follow(self, command: dict[str, Any]) -> None:
        match command:
            case {"do": "play"}:
                self._is_playing, self._due_s = True, time.monotonic()
            case {"do": "pause"}:
                self._is_playing = False
            case {"do": "step", "by": 1 | -1 as by}:
                self._is_playing = False
                self._step(by)
            case {"do": "seek", "to": to} if are_usual(to):
                self._start_at(min(max(0.0, to), self._duration_s))
            case {"do": "speed", "to": to} if are_usual(to) and _SLOWEST <= to <= _FASTEST:
                self._speed = to
            case {"do": "layer", "name": str(name)} if name in self._layers:
                self._layer = name
                if self._kept:
                    self._publish_scene(self._kept[self._place])
            case _:
                super()._follow(command)
        self._publish_player()

    def _set(self, values: Mapping[str, Any]) -> None:
        """Changes settings from the next sweep on; while paused, for the shown one at once."""
        before, settings = self._settings, self._settings.changed(values)
        self._stream.change_settings(settings)
        self._settings = settings
        self._publish_knobs()
        if settings.time != before.time:
            self._start_at(self._position_s)
        elif not self._is_playing:
            is_newest = self._target_s is None and 0 <= self._place == len(self._kept) - 1
            preview = self._kept[-1] if is_newest else self._preview
            self._start_at(self._position_s)
            if preview is not None:
                self._preview = preview
                self._show_preview(preview)

    def _show_preview(self, shown: _Shown) -> None:
        """Shows the sweep with other settings at once, from its triplet alone.

        What follows from the sweeps before it comes with the target.
        """
        # What fails here fails again, and is told, when all is estimated.
        with suppress(MnsfError):
            estimate = Stream(self._settings).flow_of(shown.sweep.example.triplet)
            self._publish_scene(replace(shown, sweep=shown.sweep._replace(estimate=estimate)))

    def _start_at(self, position_s: float) -> None:
        """Estimates from a while before a position on; shows the first sweep from there on."""
        start_ns = self._first_ns + round((position_s - _PAST_S) * NANOSECONDS)
        self._stream = Stream(self._settings)
        self._sweeps: Iterator[EstimatedSweep] = estimated_sweeps(
            self._reader.since(start_ns), self._topics, self._stream, self._warnings.append
        )
        self._paths = Paths()
        self._preview = None
        self._target_s = position_s
        self._kept.clear()
        self._place = -1

    @property
    def _position_s(self) -> float:
        return self._kept[self._place].position_s if self._kept else self._target_s or 0.0

    def _step(self, by: int) -> None:
        place = self._place + by
        if 0 <= place < len(self._kept):
            self._place = place
            self._show()
        elif self._target_s is not None:
            # From the sweep that is on its way.
            self._start_at(min(max(0.0, self._target_s + by * self._interval_s), self._duration_s))
        elif by > 0:
            self._advance()
        elif self._kept:
            self._start_at(max(0.0, self._kept[0].position_s - 1.2 * self._interval_s))

    def _advance(self) -> None:
        """Shows the next sweep, or estimates one before the target."""
        if self._place + 1 < len(self._kept):
            self._place += 1
            self._show()
            return
        sweep = next(self._sweeps, None)
        if sweep is None:
            self._end()
            return
        stamp_ns = sweep.example.triplet.current.stamp_ns
        if self._first_stamp_ns is None:
            self._first_stamp_ns = stamp_ns
        position_s = (stamp_ns - self._first_stamp_ns) / NANOSECONDS
        trails = self._paths.after(stamp_ns, *pose_and_objects(sweep))
        if self._target_s is not None and position_s < self._target_s - _SAME_S:
            self._publish_player(position_s)
            return
        self._target_s, self._preview = None, None
        self._kept.append(_Shown(position_s, sweep, trails))
        self._place = len(self._kept) - 1
        self._show()

    def _end(self) -> None:
        """Starts again at the beginning, or rests and says why if no sweep has a flow."""
        if self._kept or self._target_s != 0.0:
            self._start_at(0.0)
            return
        self._target_s, self._is_playing = None, False
        limit_s = self._settings.buffer.max_interval_s
        needed = f"three sweeps in a row are needed, at most {limit_s:g} s apart"
        reason = self._warnings[-1] if self._warnings else needed
        text = f"no sweep has a flow with these settings: {reason}"
        self._server.refuse(text)
        _LOG.warning("%s", text)
        self._publish_player()

    def _show(self) -> None:
        shown = self._kept[self._place]
        self._publish_scene(shown)
        self._publish_status(shown.sweep)
        self._publish_player()
        self._explain()
        now_s = time.monotonic()
        self._interval_s = shown.sweep.example.triplet.interval_s or USUAL_INTERVAL_S
        # Late sweeps are not caught up.
        self._due_s = max(now_s, self._due_s + self._interval_s / self._speed)

    def _publish_scene(self, shown: _Shown) -> None:
        scene = scene_of(shown.sweep, self._layer)
        self._server.publish("scene", scene_message(scene, shown.trails))

    def _explain(self) -> None:
        lines: list[str] = []
        if self._asked is not None and self._kept:
            sweep = self._kept[self._place].sweep
            self._asked = self._asked.followed(pose_and_objects(sweep)[1])
            try:
                rows = rows_at(sweep.example.triplet.current.xyz, sweep.estimate, self._asked.at)
                lines = decision(sweep.example, sweep.estimate, rows)
            except EvaluationError as error:
                lines = [str(error)]
        self._tell_reasons(lines)

    def _publish_player(self, estimated_s: float = 0.0) -> None:
        """Tells the state of the player; before the target, the position of the last estimate."""
        self._server.tell(
            "player",
            playing=self._is_playing,
            layers=self._layers,
            layer=self._layer,
            speed=self._speed,
            position=self._position_s,
            duration=self._duration_s,
            busy=None if self._target_s is None else estimated_s,
        )

    def _publish_status(self, sweep: EstimatedSweep) -> None:
        estimate, known = sweep.estimate, sweep.estimate.over_ground
        values = {
            "points": f"{len(sweep.example.triplet.current):,}",
            "dynamic objects": "unknown" if known is None else str(len(known.objects)),
            "ego motion": "unknown" if known is None else known.source,
            "own body": estimate.own_body_text,
            "estimate": f"{estimate.time_ms:.0f} ms",
        }
        self._take_own_body(boxes_around(estimate.own_body))
        self._server.tell(
            "status",
            latency=estimate.time_ms,
            values=values,
            warnings=list(self._warnings),
            lost="" if known is None else known.lost,
        )
