# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Transforms between frames that are fixed to each other, by /tf_static of a recording."""

from contextlib import suppress

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.geometry.transforms import transform_matrix
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TF_TYPE
from mnsf_ros.recording.storage_file import Damage
from msg_utils.errors import MessageError

_NAME = "/tf_static"


class StaticFrames:
    """The frames of all topics that end in /tf_static; damaged transforms are left out."""

    def __init__(self, reader: BagReader) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}
        for topic, summary in reader.topics.items():
            if topic.endswith(_NAME) and summary.has_messages(TF_TYPE):
                for item in reader.readable_messages(topic):
                    for one in () if isinstance(item, Damage) else item[1].transforms:
                        with suppress(MessageError):
                            child, parent = one.child_frame_id, one.header.frame_id
                            pose = transform_matrix(one.transform)
                            self._parents[child.lstrip("/")] = parent.lstrip("/"), pose

    def find(self, target: str, source: str) -> Floats | None:
        """Returns target_from_source (4, 4); None if nothing leads from one to the other."""
        above_target, above_source = self._above(target), self._above(source)
        common = next((frame for frame in above_target if frame in above_source), None)
        if common is None:
            return None
        return np.linalg.inv(above_target[common]) @ above_source[common]

    def _above(self, frame: str) -> dict[str, Floats]:
        """The frame and those above it, with its pose (4, 4) in each."""
        frame, pose = frame.lstrip("/"), np.eye(4)
        found = {frame: pose}
        while frame in self._parents:
            frame, step = self._parents[frame]
            pose = step @ pose
            if frame in found:  # a circle
                break
            found[frame] = pose
        return found
