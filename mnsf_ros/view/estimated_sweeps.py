# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sweeps of a recording with their flow, one after the other."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError
from mnsf_ros.methods import make_method
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import REFUSED, SweepBuffer
from mnsf_ros.sweeps_io.flow_cloud import sweep_from_message
from msg_utils.errors import MessageError

_LOG = logging.getLogger(__name__)
_NUM_SWEEPS = 3


@dataclass(frozen=True, eq=False)
class EstimatedSweep:
    """The current sweep of a triplet, whose source is its cloud, and what was estimated."""

    triplet: SweepTriplet
    estimate: FlowEstimate


def estimated_sweeps(reader: BagReader, topic: str, settings: Settings) -> Iterator[EstimatedSweep]:
    """Estimates the flow of the clouds of a topic; what has none is logged and left out.

    Raises:
        SettingsError: The method cannot be made with the settings.
        RecordingError: Damage is met in the recording.
    """
    method = make_method(settings.method.name, settings)
    buffer = SweepBuffer(max(_NUM_SWEEPS, method.traits.num_sweeps))
    for received_ns, message in reader.received_messages(topic):
        try:
            sweep = sweep_from_message(message, settings.time, received_ns)
            if len(sweep) == 0 or buffer.push(sweep, settings.buffer) in REFUSED:
                continue
            triplet = buffer.triplet()
            if triplet is not None:
                yield EstimatedSweep(triplet, method.estimate(triplet))
        except (MessageError, MnsfError) as error:
            _LOG.warning("no flow at %.3f s: %s", received_ns / 1e9, error)
