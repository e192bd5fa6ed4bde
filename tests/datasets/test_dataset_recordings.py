# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recordings of labelled sweeps: complete or not at all."""

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.conversion import write_recording
from mnsf_ros.datasets.labelled_sweep import LabelledSweep, SweepSource
from mnsf_ros.errors import DatasetError, RecordingError


def sweep(index, *, num_points=5, stamp_ns=None):
    xyz = np.random.default_rng(index).normal(size=(num_points, 3)).astype(np.float32)
    stamp_ns = tiny_world.stamp_ns(index) if stamp_ns is None else stamp_ns
    return LabelledSweep(stamp_ns, xyz, pose=np.eye(4), boxes=())


def source(*sweeps):
    return SweepSource("somewhere", len(sweeps), iter(sweeps))


def failing(error):
    yield sweep(0)
    yield sweep(1)
    raise error


@pytest.mark.parametrize("error", [DatasetError("damaged"), KeyboardInterrupt()])
def test_a_failure_leaves_nothing_behind(tmp_path, error):
    with pytest.raises(type(error)):
        write_recording(SweepSource("a", 3, failing(error)), tmp_path / "file.mcap")
    assert not list(tmp_path.iterdir())


def test_stamps_must_rise(tmp_path):
    for stamp_ns in (tiny_world.stamp_ns(0), 5):
        with pytest.raises(DatasetError, match=rf"stamp {stamp_ns} ns comes after \d+ ns"):
            write_recording(source(sweep(0), sweep(1, stamp_ns=stamp_ns)), tmp_path / "bag")
    with pytest.raises(RecordingError, match="stamp_ns is -1"):
        write_recording(source(sweep(0, stamp_ns=-1)), tmp_path / "bag")


def test_a_part_of_a_source():
    part = source(*map(sweep, range(4))).part(3, 9)
    assert part.num_sweeps == len(list(part.sweeps)) == 1
    for first, count in ((4, None), (-1, None), (0, 0)):
        with pytest.raises(DatasetError, match=r"only 4 sweeps|expected at least 0 and 1"):
            source(*map(sweep, range(4))).part(first, count)
