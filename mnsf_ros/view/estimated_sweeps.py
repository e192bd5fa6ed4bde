# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of a recording with their flow, in stamp order."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.tracks import in_stamp_order
from mnsf_ros.online.stream import Stream
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.settings import Settings, TimeSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep, SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import sweep_from_message
from msg_utils.errors import MessageError

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class EstimatedSweep:
    """A triplet, the source of whose current sweep is its cloud, with its estimate."""

    triplet: SweepTriplet
    estimate: FlowEstimate


def estimated_sweeps(reader: BagReader, topic: str, settings: Settings) -> Iterator[EstimatedSweep]:
    """Estimates the flow of the clouds of a topic; failures are logged and left out.

    Raises:
        SettingsError: The method cannot be made with the settings.
        RecordingError: Damage is met in the recording.
    """
    stream = Stream(settings)
    for sweep in filter(None, in_stamp_order(_sweeps(reader, topic, settings.time))):
        try:
            estimate = stream.push(sweep)
        except MnsfError as error:
            _LOG.warning("no flow at %.3f s: %s", sweep.stamp_ns / NANOSECONDS, error)
            continue
        if estimate is not None and stream.triplet is not None:
            yield EstimatedSweep(stream.triplet, estimate)


def _sweeps(reader: BagReader, topic: str, settings: TimeSettings) -> Iterator[Sweep]:
    for received_ns, message in reader.received_messages(topic):
        try:
            sweep = sweep_from_message(message, settings, received_ns)
        except MessageError as error:
            _LOG.warning("no flow at %.3f s: %s", received_ns / NANOSECONDS, error)
            continue
        if len(sweep) > 0:
            yield sweep
