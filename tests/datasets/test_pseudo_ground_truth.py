# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.argoverse1 import ARGOVERSE1
from mnsf_ros.datasets.argoverse2 import ARGOVERSE2, argoverse2_classes
from mnsf_ros.datasets.kitti import KITTI
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep
from mnsf_ros.datasets.nuscenes import nuscenes_class
from mnsf_ros.datasets.pseudo_ground_truth import TruthSettings, sweep_truth
from mnsf_ros.datasets.waymo import WAYMO

SETTINGS = TruthSettings()


def labelled(index, **changes):
    boxes = tuple(
        Box(pose, tiny_world.SIZE, tiny_world.CAR, track)
        for track, pose in tiny_world.boxes(index).items()
    )
    sweep = LabelledSweep(
        tiny_world.stamp_ns(index),
        tiny_world.sweep(index).xyz,
        pose=tiny_world.world_from_sweep(index),
        boxes=boxes,
    )
    return replace(sweep, **changes)


def part(index=0):
    return tiny_world.sweep(index).part


def test_points_move_with_their_box_and_all_others_with_the_vehicle():
    truth = sweep_truth(labelled(0), labelled(1), SETTINGS)
    tiny_world.check_truth(truth, 0, tiny_world.sweep(0).xyz, part())
    # The ground below a box stays.
    local = tiny_world.carried(np.linalg.inv(tiny_world.boxes(0)["mover"]), labelled(0).xyz)
    below = (np.abs(local[:, :2]) < tiny_world.SIZE[:2] / 2).all(axis=1) & (local[:, 2] < -0.8)
    assert below.sum() > 10
    assert truth.ground[below].all()
    assert not truth.dynamic[below].any()


def test_the_margin_decides_what_is_beside_a_box():
    for margin_m, expected in ((0.3, False), (0.5, True)):
        truth = sweep_truth(labelled(0), labelled(1), TruthSettings(box_margin_m=margin_m))
        # They are 0.2 m outside, and half of the margin is on either side.
        assert set(truth.dynamic[part() == tiny_world.MARGIN]) == {expected}


def test_nothing_is_valid_without_a_next_sweep_or_poses():
    for truth in (
        sweep_truth(labelled(0), None, SETTINGS),
        sweep_truth(labelled(0, pose=None), labelled(1), SETTINGS),
        sweep_truth(labelled(0), labelled(1, pose=None), SETTINGS),
    ):
        assert not truth.valid.any()
        assert not truth.dynamic.any()
        assert (truth.class_id[part() == tiny_world.MOVER] == tiny_world.CAR).all()


def unknown(boxes):
    return tuple(replace(box, track_id=None) for box in boxes)


def twice(boxes):
    mover, parked, *others = boxes
    return (mover, replace(parked, track_id=mover.track_id), *others)


@pytest.mark.parametrize(("index", "change"), [(0, unknown), (0, twice), (1, twice)])
def test_boxes_of_unknown_motion_have_no_valid_flow(index, change):
    sweeps = [labelled(0), labelled(1)]
    sweeps[index] = labelled(index, boxes=change(sweeps[index].boxes))
    truth = sweep_truth(*sweeps, SETTINGS)
    on_box = truth.class_id == tiny_world.CAR
    assert on_box.any()
    assert not truth.valid[on_box].any()
    assert truth.valid[~on_box].all()


def test_a_hidden_box_owns_no_points_but_tells_where_the_object_went():
    boxes = tuple(replace(box, hidden=True) for box in labelled(0).boxes)
    assert not sweep_truth(labelled(0, boxes=boxes), labelled(1), SETTINGS).dynamic.any()
    boxes = tuple(replace(box, hidden=True) for box in labelled(1).boxes)
    truth = sweep_truth(labelled(0), labelled(1, boxes=boxes), SETTINGS)
    assert truth.dynamic[part() == tiny_world.MOVER].all()


@pytest.mark.parametrize("interval_s", [0.05, 0.1, 1.0])
def test_what_is_dynamic_depends_on_the_speed(interval_s):
    still = np.eye(4)
    shift = np.eye(4)
    xyz = np.zeros((1, 3), np.float32)
    for speed, expected in ((0.49, False), (0.51, True)):
        shift[0, 3] = speed * interval_s
        sweeps = [
            LabelledSweep(stamp, xyz, pose=still, boxes=(Box(pose, np.ones(3), 7, "a"),))
            for stamp, pose in ((0, still), (round(interval_s * 1e9), shift))
        ]
        assert sweep_truth(*sweeps, SETTINGS).dynamic[0] == expected


def test_a_box_in_a_box_gets_its_own_points():
    small = Box(np.eye(4), np.ones(3), tiny_world.PERSON, "small")
    large = Box(tiny_world.pose(2, 0, 0, 0), np.full(3, 3.0), tiny_world.CAR, "large")
    # Inside the small one, inside the large one, and nearer to the middle of the large one.
    xyz = np.array([[0.1, 0, 0], [1.5, 0, 0], [0.49, 0, 0], [0.7, 0, 0]], np.float32)
    for boxes in ((small, large), (large, small)):
        sweep = LabelledSweep(0, xyz, pose=np.eye(4), boxes=boxes, ground=np.zeros(4, bool))
        truth = sweep_truth(sweep, replace(sweep, stamp_ns=1), TruthSettings(1.0))
        assert truth.class_id.tolist() == [7, 6, 7, 6]


def test_official_boxes_are_longer_and_wider_and_own_their_ground():
    first = Box(np.eye(4), np.array([4.0, 2.0, 1.0]), tiny_world.CAR, "first")
    second = Box(tiny_world.pose(3, 0, 0, 0), first.size_m, tiny_world.PERSON, "second")
    places = {
        (0, 0, -0.49): tiny_world.CAR,
        (0, 1.09, 0): tiny_world.CAR,
        (-2.09, 0, 0): tiny_world.CAR,
        (0, 0, 0.51): 0,
        (0, 1.11, 0): 0,
        (1.5, 0, 0): tiny_world.PERSON,  # in both, and as deep in either
        (1.2, 0, 0): tiny_world.PERSON,  # deeper in the first one
    }
    xyz = np.array(list(places), np.float32)
    boxes = (first, second)
    sweep = LabelledSweep(0, xyz, pose=np.eye(4), boxes=boxes, ground=np.ones(len(xyz), bool))
    truth = sweep_truth(sweep, replace(sweep, stamp_ns=1), TruthSettings(official=True))
    assert truth.class_id.tolist() == list(places.values())
    hidden = tuple(replace(box, hidden=box is first) for box in boxes)
    following = replace(sweep, stamp_ns=1, boxes=hidden)
    truth = sweep_truth(sweep, following, TruthSettings(official=True))
    assert truth.valid.tolist() == [kind != tiny_world.CAR for kind in places.values()]


def test_given_flow_is_kept_and_what_it_lacks_is_found():
    xyz, parts = tiny_world.sweep(0).xyz, part()
    flow = tiny_world.expected_flow(0, xyz, parts).astype(np.float32)
    moving = tiny_world.moves(parts)
    valid = np.arange(len(xyz)) % 5 > 0
    for pose in (tiny_world.world_from_sweep(0), None):  # by the poses, or by what most points do
        sweep = labelled(0, flow=flow, flow_valid=valid, pose=pose, boxes=None)
        truth = sweep_truth(sweep, labelled(1), SETTINGS)
        assert np.array_equal(truth.flow, flow)
        assert np.array_equal(truth.valid, valid)
        assert np.array_equal(truth.dynamic, moving & valid)
    classes = np.full(len(xyz), 3, np.uint8)
    given = labelled(0, flow=flow, flow_valid=valid, dynamic=~moving, class_id=classes)
    truth = sweep_truth(given, labelled(1), SETTINGS)
    assert np.array_equal(truth.dynamic, ~moving & valid)
    assert np.array_equal(truth.class_id, classes)


def test_categories_of_the_data_sets():
    assert [KITTI.get(name, 0) for name in ("Tram", "Person (sitting)", "Misc")] == [10, 7, 0]
    assert [ARGOVERSE1.get(name, 0) for name in ("BUS", "MOPED", "ANIMAL")] == [10, 8, 0]
    assert [ARGOVERSE2.get(name, 0) for name in ("SIGN", "WHEELCHAIR", "DOG")] == [11, 7, 12]
    assert [WAYMO.get(number, 0) for number in range(5)] == [0, 6, 7, 11, 8]
    names = ("vehicle.bus.rigid", "vehicle.bicycle", "human.pedestrian.adult", "animal")
    assert [nuscenes_class(name) for name in names] == [10, 8, 7, 12]
    # Background, animal, regular vehicle, the last one.
    assert argoverse2_classes(np.array([0, 1, 19, 30])).tolist() == [0, 12, 6, 8]
    for number in (-1, 31):
        with pytest.raises(ValueError, match=f"category number {number}, expected 0 to 30"):
            argoverse2_classes(np.array([3, number]))
