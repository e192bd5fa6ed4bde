# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A vehicle, a car that drives, one that is parked and one that is gone after the first sweep.

Tests write it in the layout of a data set, convert it, and compare what comes out with laws: the
ground and the walls move as the vehicle does, the points of a car as its box does.
"""

import math
import re
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_truth import read_sensor_poses, read_truth

from mnsf_ros.datasets.conversion import open_source, write_recording
from mnsf_ros.errors import DatasetError
from mnsf_ros.recording.bag_reader import BagReader
from msg_utils.point_cloud2 import decode_points, decode_xyz
from msg_utils.stamps import decode_stamp

NUM_SWEEPS = 3
FIRST_NS = 1_600_000_000_100_000_000
STEP_NS = 100_000_000
SIZE = np.array([4.0, 2.0, 1.6])
CAR, PERSON, CYCLIST, THING = 6, 7, 8, 9
STATIC, MOVER, MARGIN, OUTSIDE, PARKED, GONE = range(6)


def pose(x, y, z, turn):
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, z], [0, 0, 0, 1]], float)


def yaw(pose):
    return math.atan2(pose[1, 0], pose[0, 0])


def quaternion(pose):
    """Real part first."""
    return [math.cos(yaw(pose) / 2), 0.0, 0.0, math.sin(yaw(pose) / 2)]


def carried(transform, points):
    return points @ transform[:3, :3].T + transform[:3, 3]


def stamp_ns(index):
    return FIRST_NS + index * STEP_NS


def world_from_sweep(index):
    return pose(0.8 * index, 0.1 * index, 0, 0.03 * index)


def world_from_box(track, index):
    if track == "mover":
        return pose(10 + 1.1 * index, 4 + 0.3 * index, 0.85, 0.2 + 0.06 * index)
    return pose(-9, -5, 0.85, 1.0) if track == "parked" else pose(3, -8, 0.85, -0.5)


def boxes(index):
    """Track -> (4, 4) `sweep_from_box`."""
    tracks = ("mover", "parked", "gone") if index == 0 else ("mover", "parked")
    sweep_from_world = np.linalg.inv(world_from_sweep(index))
    return {track: sweep_from_world @ world_from_box(track, index) for track in tracks}


@dataclass(frozen=True)
class TinySweep:
    """Points (N, 3) float32 in the frame of the sweep, and what each of them is (N,)."""

    xyz: np.ndarray
    part: np.ndarray


@cache
def sweep(index, num_points=40):
    """One sweep; its points and those of the next one do not correspond."""
    rng = np.random.default_rng(index)
    inside = rng.uniform(-0.49, 0.49, (num_points, 3)) * SIZE * (1, 1, 0.5) + (0, 0, 0.3)
    side = np.where(rng.random(num_points) < 0.5, -1, 1) * (SIZE[1] / 2 + 0.2)
    along, up = rng.uniform(-1.5, 1.5, num_points), rng.uniform(0.0, 0.7, num_points)
    beside, outside = (np.column_stack([along, side * far, up]) for far in (1, 7 / 6))
    wall = rng.uniform((-12, 11, 0.5), (12, 11, 3), (4 * num_points, 3))
    steps = np.arange(-13.75, 14, 0.5)  # no point at the origin: that is no return
    ground = np.stack(np.meshgrid(steps, steps, 0.0), -1).reshape(-1, 3)
    sweep_from_world = np.linalg.inv(world_from_sweep(index))
    found = boxes(index)
    parts = [
        (STATIC, carried(sweep_from_world, wall)),
        (STATIC, ground),
        (MOVER, carried(found["mover"], inside)),
        (MARGIN, carried(found["mover"], beside)),
        (OUTSIDE, carried(found["mover"], outside)),
        (PARKED, carried(found["parked"], inside)),
    ]
    if "gone" in found:
        parts.append((GONE, carried(found["gone"], inside)))
    xyz = np.vstack([points for _, points in parts])
    part = np.concatenate([np.full(len(points), kind) for kind, points in parts])
    order = rng.permutation(len(xyz))
    return TinySweep(xyz[order].astype(np.float32), part[order])


def moves(part):
    """(N,) whether points are of the car that drives."""
    return np.isin(part, (MOVER, MARGIN))


def expected_flow(index, xyz, part):
    """(N, 3) flow of points by what they are."""
    ego = np.linalg.inv(world_from_sweep(index + 1)) @ world_from_sweep(index)
    moving = boxes(index + 1)["mover"] @ np.linalg.inv(boxes(index)["mover"])
    xyz = xyz.astype(float)
    return np.where(moves(part)[:, None], carried(moving, xyz), carried(ego, xyz)) - xyz


def check_truth(truth, index, xyz, part, *, tolerance=1e-4):
    """Compares the truth of a sweep with what must hold."""
    if index == NUM_SWEEPS - 1:
        assert not truth.valid.any()
        assert not truth.dynamic.any()
        return
    assert np.array_equal(truth.valid, part != GONE)
    flow = expected_flow(index, xyz, part)
    np.testing.assert_allclose(truth.flow[truth.valid], flow[truth.valid], atol=tolerance)
    assert np.array_equal(truth.dynamic, moves(part))
    on_box = np.isin(part, (MOVER, MARGIN, PARKED, GONE))
    assert set(truth.class_id[~on_box]) == {0}
    assert set(truth.class_id[on_box]) == {CAR}
    assert not truth.ground[on_box].all()


def convert(name, source, out, settings=None, **options):
    """Writes the recording of a data set, and returns its path."""
    write_recording(open_source(name, source, **options), out, settings)
    return out


def check_refused(name, source, file, change, message, **options):
    """A changed file is refused in one line with its name.

    The change is the number of bytes that are kept, the new content (None: there is no such file),
    what is replaced by what, or a function of the content.
    """
    path = source / file
    content = path.read_bytes()
    match change:
        case int():
            content = content[:change]
        case (old, new):
            assert old in content
            content = content.replace(old, new)
        case bytes() | None:
            content = change
        case _:
            content = change(content)
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DatasetError, match=rf"{re.escape(path.name)}: .*{message}") as caught:
        list(open_source(name, source, **options).sweeps)
    assert "\n" not in str(caught.value)


def read(path):
    """Stamps, frames, points, truth and poses of a recording; lists have an entry a sweep."""
    with BagReader(path) as reader:
        messages = list(reader.messages("/points"))
        stamps = [decode_stamp(message.header.stamp) for message in messages]
        truth = read_truth(reader)
        return SimpleNamespace(
            stamps=stamps,
            frames={message.header.frame_id for message in messages},
            xyz=[decode_xyz(message)[0] for message in messages],
            columns=[decode_points(message).ravel() for message in messages],
            truth=[truth[stamp] for stamp in stamps],
            poses=read_sensor_poses(reader) if "/truth/odometry" in reader.topics else {},
        )


def check_recording(path, frame_id, *, tolerance=1e-4):
    """Compares a whole recording of the tiny world; returns what was read."""
    found = read(path)
    assert found.stamps == [stamp_ns(index) for index in range(NUM_SWEEPS)]
    assert found.frames == {frame_id}
    assert list(found.poses) == found.stamps
    first = np.linalg.inv(found.poses[found.stamps[0]])
    for index, stamp in enumerate(found.stamps):
        tiny = sweep(index)
        np.testing.assert_allclose(found.xyz[index], tiny.xyz, atol=tolerance)
        check_truth(found.truth[index], index, tiny.xyz, tiny.part, tolerance=tolerance)
        np.testing.assert_allclose(
            first @ found.poses[stamp], world_from_sweep(index), atol=tolerance
        )
    return found
